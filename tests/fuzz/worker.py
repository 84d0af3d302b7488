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
"""Beyond what the imports took."""


class TooLong(BaseException):
    """A mutant that hangs; no `except Exception` may catch it."""


def _too_long(*_):
    raise TooLong


def one(target, name, number, folder):
    """Write mutant `number` of a target, read it, and say how it ended; raises what reading raised."""
    from mutators import mutated, mutated_text

    seed = f"{name} {number}"
    whole = target.files[number % len(target.files)]
    other = target.files[(number * 7 + 1) % len(target.files)]
    changed = list(whole)[number // len(target.files) % len(whole)]
    for file, content in whole.items():
        data, more = content, next(iter(other.values()))
        if file == changed:
            text = target.text
            data = mutated_text(content.decode(), more.decode(), seed) if text else mutated(content, more, seed)
        (folder / file).write_bytes(data)
    return target.read(folder, whole)


def main():
    name, first, last, folder = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    from targets import all_targets

    with tempfile.TemporaryDirectory() as scratch:
        target = all_targets(Path(scratch))[name]
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
        signal.signal(signal.SIGALRM, _too_long)
        ended, wrong = Counter(), {}
        for number in range(first, last):
            (folder / "at").write_text(str(number))
            signal.alarm(MOST_SECONDS)
            try:
                ended[one(target, name, number, Path(scratch))] += 1
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                ended["wrong"] += 1
                where = traceback.extract_tb(error.__traceback__)[-1]
                wrong[number] = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"[:300]
            finally:
                signal.alarm(0)
    print(json.dumps({"ended": dict(ended), "wrong": wrong}))


if __name__ == "__main__":
    main()
