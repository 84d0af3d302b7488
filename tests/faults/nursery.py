"""A process that has imported everything, and forks a child for each command: to import takes longer than to run.

It reads one JSON object a line (`argv`, `cwd`, `out`, and a fault) and answers with the child's process id, and once
the child has ended with its exit code (negative: the signal). The fault is planted in the child only.

A step is what changes the file system below `cwd`: a file opened to be written, a folder made, a rename, a removal,
an fsync. All but the fsync are audit events of Python, so that no function of the package is replaced. What pyarrow and
safetensors write by themselves lies between steps; `most_bytes` is for them.
"""

import errno
import importlib
import json
import os
import pkgutil
import resource
import shutil
import signal
import sys
from pathlib import Path

import maglev_offline

STEPS = {"os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.truncate"}
LEFT_OUT = ("__main__", "d3rlpy", "minari", "torchrl", "libmaglev_kernel")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class Fault:
    """What happens at step `at` (from 1): `kind` is kill, stop, full, denied, gone or count."""

    def __init__(self, kind, at, of, count_to):
        self.kind, self.at, self.of, self.count_to = kind, at, of, count_to
        self.home, self.process, self.steps, self.busy = str(Path.cwd()), os.getpid(), 0, False

    def audit(self, event, args):
        if event == "open":
            path, _, flags = args
            if isinstance(path, int) or not flags & WRITING:
                return
        elif event in STEPS:
            path = args[0]
        else:
            return
        if isinstance(path, bytes | str | os.PathLike):
            self.step(str(Path.cwd() / os.fsdecode(path)), event in ("os.remove", "os.rmdir"))

    def step(self, path, removing=False):
        if self.busy or not path.startswith(self.home) or path.endswith((".stdout", ".stderr", ".steps")):
            return
        self.steps += 1
        if self.kind == "count":
            self.busy = True
            Path(self.count_to).write_text(str(self.steps))
            self.busy = False
        elif self.steps == self.at:
            if removing and self.kind in ("full", "denied"):  # a full disk lets files be removed
                self.at += 1
                return
            self.busy = True
            try:
                self.happen(path)
            finally:
                self.busy = False

    def happen(self, path):
        if self.kind in ("kill", "stop"):
            os.kill(os.getpid(), signal.SIGKILL if self.kind == "kill" else signal.SIGSTOP)
        elif self.kind == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        elif self.kind == "denied":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        elif self.kind == "gone":
            shutil.rmtree(self.of) if Path(self.of).is_dir() else Path(self.of).unlink()


def plant(fault):
    if fault.get("most_bytes"):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (fault["most_bytes"], fault["most_bytes"]))
    if not fault.get("kind"):
        return
    planted = Fault(fault["kind"], fault.get("at", 0), fault.get("of"), fault.get("count_to"))
    sync = os.fsync

    def counted(handle):
        planted.step(planted.home)
        sync(handle)

    os.fsync = counted
    sys.addaudithook(planted.audit)


def child(order):
    os.chdir(order["cwd"])
    for stream, name in ((1, "stdout"), (2, "stderr")):
        handle = os.open(f"{order['out']}.{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, stream)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
    sys.argv = ["maglev-offline", *order["argv"]]
    from maglev_offline import cli

    plant(order["fault"])
    code = cli.run()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def fork(order):
    process = os.fork()
    if process == 0:
        try:
            child(order)
        finally:
            os._exit(99)
    return process


def main():
    for module in pkgutil.walk_packages(maglev_offline.__path__, "maglev_offline."):
        if module.name.rpartition(".")[2] not in LEFT_OUT:
            importlib.import_module(module.name)
    print("ready", flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        process = fork(order)
        print(process, flush=True)
        if order["wait"]:
            status = os.waitpid(process, 0)[1]
        else:
            status = os.waitpid(process, os.WUNTRACED)[1]  # it has stopped, or ended before it could
            print("stopped" if os.WIFSTOPPED(status) else "ended", flush=True)
            while (meanwhile := sys.stdin.readline()).strip():
                print(os.waitstatus_to_exitcode(os.waitpid(fork(json.loads(meanwhile)), 0)[1]), flush=True)
            if os.WIFSTOPPED(status):
                os.kill(process, signal.SIGCONT)
                status = os.waitpid(process, 0)[1]
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
