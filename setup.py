"""Build the native kernel with the package, where a C++ compiler is: without one the package installs and runs as well.

Everything else about the package is in pyproject.toml. The kernel is a plain shared library, no Python module: it is
compiled once for each instruction set and holds them all.
"""

import platform
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70.1
    from wheel.bdist_wheel import bdist_wheel

SOURCES = Path("maglev_offline/native")


def hash_of_sources() -> str:
    """As in agents/native_library.py, which takes no library that was built from other sources."""
    paths = sorted(path for path in SOURCES.iterdir() if path.suffix in (".h", ".hpp", ".cpp"))
    return sha256(b"".join(path.name.encode() + path.read_bytes() for path in paths)).hexdigest()[:16]


# No -ffast-math: it would flush tiny numbers to zero in the whole process. NaN and infinity keep their meaning.
COMMON = ["-std=c++17", "-O3", "-fvisibility=hidden", "-fno-exceptions", "-fno-rtti", "-fno-math-errno"]
COMMON += ["-fno-trapping-math", "-Wno-psabi", "-g0"]
EXACT, FUSED = ["-ffp-contract=off"], ["-ffp-contract=fast"]
PORTABLE = {"plant.cpp": EXACT, "kernel.cpp": [f'-DMAGLEV_SOURCES="{hash_of_sources()}"'], "isa_baseline.cpp": FUSED}
AVX2 = ["-mavx2", "-mfma"]
AVX512 = [*AVX2, "-mavx512f", "-mavx512vl", "-mavx512dq", "-mavx512bw", "-mprefer-vector-width=512"]
X86 = {**PORTABLE, "isa_avx2.cpp": FUSED + AVX2, "isa_avx512.cpp": FUSED + AVX512}


def flags_of_sources() -> dict[str, list[str]]:
    """The flags of each source, by its name."""
    on_x86 = platform.machine().lower() in ("x86_64", "amd64") and "64" in platform.architecture()[0]
    listed = X86 if on_x86 else PORTABLE
    return {name: [*COMMON, *(["-DMAGLEV_X86"] if on_x86 else []), *flags] for name, flags in listed.items()}


class BuildKernel(build_ext):
    """Compile each source with its own flags and link one library, whose name has no Python version in it."""

    def build_extension(self, ext: Extension) -> None:
        """Compile and link; setuptools turns a failure into a warning, since the extension is optional."""
        library = Path(self.get_ext_fullpath(ext.name))
        library.unlink(missing_ok=True)  # a failure must not leave an older one in its place

        def compiled(name: str, flags: list[str]) -> list[str]:
            source = str(SOURCES / name)
            found: list[str] = self.compiler.compile(
                [source], output_dir=self.build_temp, extra_postargs=flags, depends=ext.depends
            )
            return found

        with ThreadPoolExecutor() as pool:  # each source takes seconds, in a process of its own
            objects = [
                made for one in pool.map(compiled, *zip(*flags_of_sources().items(), strict=True)) for made in one
            ]
        self.compiler.link_shared_object(objects, str(library), target_lang="c++")

    def get_ext_filename(self, fullname: str) -> str:
        """`maglev_offline/native/libmaglev_kernel.so`, on every platform: ctypes does not mind the suffix."""
        return str(Path(*fullname.split(".")).with_suffix(".so"))


class AnyPython(bdist_wheel):
    """The library does not depend on the version of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        """`py3-none-` and the platform."""
        return "py3", "none", super().get_tag()[2]


kernel = Extension(
    "maglev_offline.native.libmaglev_kernel",
    sources=[str(SOURCES / name) for name in flags_of_sources()],
    depends=sorted(str(path) for pattern in ("*.hpp", "*.h") for path in SOURCES.glob(pattern)),
    language="c++",
    optional=True,
)

setup(ext_modules=[kernel], cmdclass={"build_ext": BuildKernel, "bdist_wheel": AnyPython})
