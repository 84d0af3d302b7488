"""Reads mutants of one target, `first` to `last`, each within a time, all within a memory; says what came of them.

    python worker.py TARGET FIRST LAST FOLDER

The number of the mutant at hand is in FOLDER/at, so that one that ends the process can be named. The last line is JSON.
"""

import json
import resource
import signal
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

MOST_SECONDS = 10
MOST_BYTES = 2**30
"""Beyond what the imports took; measured, since allocators reserve more addresses than they use."""

MOST_ADDRESSES = 8 * 2**30
"""So that no mutant takes the machine with it."""


class TooLong(BaseException):
    """A mutant that hangs; no `except Exception` may catch it."""


def _too_long(*_):
    raise TooLong


def one(target, name, number, folder):
    """Write mutant `number` of a target, read it, and say how it ended; raises what reading raised.

    None: a file as it is whole.
    """
    if number is None:
        for file, content in target.files[0].items():
            (folder / file).write_bytes(content)
        return target.read(folder, target.files[0])
    seed = f"{name} {number}"
    whole = target.files[number % len(target.files)]
    other = target.files[(number * 7 + 1) % len(target.files)]
    changed = list(whole)[number // len(target.files) % len(whole)]
    for file, content in whole.items():
        more = next(iter(other.values()))
        (folder / file).write_bytes(target.change(content, more, seed) if file == changed else content)
    return target.read(folder, whole)


def _peak_bytes():
    """The most memory that the process held at once."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _guarded(target, name, number, folder, most_bytes):
    """As `one`; a mutant that takes too long raises, and one that takes too much memory ends the process."""
    signal.alarm(MOST_SECONDS)
    try:
        return one(target, name, number, folder)
    finally:
        signal.alarm(0)
        if _peak_bytes() > most_bytes:  # a peak is not forgotten, so that the next one needs a new process
            sys.exit(f"mutant {number} of {name} took more than {MOST_BYTES:,} bytes")


def main():
    name, first, last, folder = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    from targets import all_targets

    with tempfile.TemporaryDirectory() as scratch:
        target = all_targets(Path(scratch))[name]
        resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES, MOST_ADDRESSES))
        signal.signal(signal.SIGALRM, _too_long)
        most_bytes = _peak_bytes() + MOST_BYTES
        ended, wrong = Counter(), {}
        for number in range(first, last):
            (folder / "at").write_text(str(number))
            try:
                ended[_guarded(target, name, number, Path(scratch), most_bytes)] += 1
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:
                ended["wrong"] += 1
                where = traceback.extract_tb(error.__traceback__)[-1]
                wrong[number] = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"[:300]
    print(json.dumps({"ended": dict(ended), "wrong": wrong}))


if __name__ == "__main__":
    main()
