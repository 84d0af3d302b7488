"""The entry point. `--version` answers before anything heavy is imported."""

import sys

from maglev_offline import __version__


def main() -> None:
    """Run the command line and end the process with its exit code."""
    if sys.argv[1:] == ["--version"]:
        print(f"maglev-offline {__version__}")
        return
    try:
        from maglev_offline.cli import run

        code = run()
    except ModuleNotFoundError as error:  # of what the command line itself needs, so that `doctor` cannot tell of it
        print(
            f"error: the package {error.name} is not here. Install maglev-offline into this Python, {sys.executable}, "
            "or take the one that it is installed in (`make setup` in its folder makes one).",
            file=sys.stderr,
        )
        code = 2
    sys.exit(code)


if __name__ == "__main__":
    main()
