"""The entry point. `--version` answers before anything heavy is imported."""

import sys

from maglev_offline import __version__


def main() -> None:
    """Run the command line and end the process with its exit code."""
    if sys.argv[1:] == ["--version"]:
        print(f"maglev-offline {__version__}")
        return
    from maglev_offline.cli import run

    sys.exit(run())


if __name__ == "__main__":
    main()
