"""Look at an installed wheel from outside the source tree: the native engine is inside, and trains.

Run it with the Python that the wheel is installed in. cibuildwheel does so for each wheel, `.ci/wheel` for one.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

DOCTOR = [sys.executable, "-P", "-m", "maglev_offline", "doctor", "--json", "--workspace", "workspace"]
"""-P: nothing is taken from the folder that it runs in."""


def main() -> None:
    """Run the doctor, and end with an error where the wheel is not what it should be."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(DOCTOR, cwd=folder, capture_output=True, text=True)
        left = list(Path(folder).iterdir())
    if not done.stdout:
        sys.exit(done.stderr)
    checks = {check["code"]: check for check in json.loads(done.stdout)["checks"]}
    print(json.dumps({code: checks[code] for code in ("package", "python", "native", "training")}, indent=2))
    problems = [check for check in checks.values() if check["state"] == "problem"]
    lacks = {
        "the doctor found nothing in the way": not problems and done.returncode == 0,
        "the package is the installed one": not checks["package"]["facts"]["source_tree"],
        "the native engine is inside": checks["native"]["facts"]["here"],
        "it trains": checks["training"]["facts"]["engine"] == "native",
        "nothing is left behind": not left,
    }
    if not all(lacks.values()):
        sys.exit("\n".join([f"not so: {what}" for what, so in lacks.items() if not so] + [str(p) for p in problems]))


if __name__ == "__main__":
    main()
