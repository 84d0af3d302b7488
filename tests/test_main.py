import subprocess
import sys
import time

import pytest

from maglev_offline import __version__

LOOK = """
import sys
sys.argv = ["maglev-offline", *{arguments!r}]
from maglev_offline.__main__ import main
try:
    main()
except SystemExit:
    pass
print(sorted({{"torch", "pandas", "scipy", "matplotlib", "control"}} & set(sys.modules)), file=sys.stderr)
"""


def run(*arguments):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True)


def test_the_version_is_answered_at_once():
    took = []
    for _ in range(5):
        start = time.perf_counter()
        assert run("-m", "maglev_offline", "--version").stdout == f"maglev-offline {__version__}\n"
        took.append(time.perf_counter() - start)
    assert min(took) < 0.3


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["train", "--help"], ["ingest"]])
def test_nothing_heavy_is_imported_before_there_is_work(arguments):
    assert run("-c", LOOK.format(arguments=arguments)).stderr.splitlines()[-1] == "[]"
