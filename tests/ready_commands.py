"""Commands in processes of their own that begin at once: forked from one that has imported what they take.

Such a command is its own process, in a session of its own, with its own memory, files and signals; only the imports,
which take longer than a small command does, are those of the process it was forked from. That a command starts as a
program of its own is seen where a test runs `python -m msl_fem.cli`.
"""

import functools
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MODULES = {
    "table": ("msl_fem.cli.table", "msl_fem.computing.machine_code", "scipy.optimize", "scipy.sparse.linalg",
              "scipy.interpolate", "h5netcdf", "rich.progress"),
    "size": ("msl_fem.cli.size", "msl_fem.computing.machine_code", "scipy.optimize", "scipy.sparse.linalg",
             "scipy.interpolate", "h5netcdf", "rich.progress"),
}  # fmt: skip
"""What is imported beforehand, by command."""


class Command:
    """A command that was started, as `subprocess.Popen` has it."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self.files = [tempfile.TemporaryFile("w+") for _ in range(2)]  # noqa: SIM115 - read when it has ended
        self._status, theirs = os.pipe()
        request = json.dumps([words, str(folder)]).encode()
        socket.send_fds(ready(words[0]), [request], [theirs, *(file.fileno() for file in self.files)])
        os.close(theirs)
        self.returncode: int | None = None
        self.pid = int(os.read(self._status, 20))

    def poll(self) -> int | None:
        """The exit status, minus the signal's number where one ended it; None while it runs."""
        return self._ended(0.0)

    def communicate(self, timeout: float = 600.0) -> tuple[str, str]:
        """What it wrote on stdout and on stderr, once it has ended."""
        end = time.monotonic() + timeout
        while self._ended(end - time.monotonic()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("a forked command", timeout)
        for file in self.files:
            file.seek(0)
        return self.files[0].read(), self.files[1].read()

    def send_signal(self, number: int) -> None:
        """To this process alone."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def _ended(self, wait: float) -> int | None:
        if self.returncode is None and select.select([self._status], [], [], max(wait, 0.0))[0]:
            self.returncode = int(os.read(self._status, 20))
            os.close(self._status)
        return self.returncode


@functools.cache
def ready(command: str) -> socket.socket:
    """The channel to the process that forks; it ends with this one, whose end of the channel is then closed."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        words = [sys.executable, __file__, str(theirs.fileno()), *MODULES[command]]
        subprocess.Popen(words, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
    return ours


def serve(channel: socket.socket) -> None:
    """Forks for every request; returns in the process that is the command's, and in this one at the end of requests."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that wait
    while True:
        request, files, *_ = socket.recv_fds(channel, 1 << 16, 3)
        if not request:
            sys.exit(0)
        if os.fork() == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            command = os.fork()
            if command == 0:
                channel.close()
                become(*json.loads(request), *files)
                return
            tell_the_end(command, files)
        for file in files:
            os.close(file)


def become(words: list[str], folder: str, status: int, *streams: int) -> None:
    """Makes of this process that of the command. SIGINT is not ignored, as it is in what a shell has in background."""
    os.close(status)
    os.setsid()
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number, stream in enumerate(streams, 1):
        os.dup2(stream, number)
        os.close(stream)
    sys.argv = ["msl-fem", *words]


def tell_the_end(command: int, files: list[int]) -> None:
    """The command's number at once, and its exit status when it has ended."""
    for file in files[1:]:
        os.close(file)
    os.write(files[0], str(command).encode())
    _, status = os.waitpid(command, 0)
    try:
        os.write(files[0], str(os.waitstatus_to_exitcode(status)).encode())
    finally:
        os._exit(0)


if __name__ == "__main__":
    import gc
    import importlib

    from msl_fem.cli.__main__ import main

    for module in sys.argv[2:]:
        importlib.import_module(module)
    gc.freeze()
    serve(socket.socket(fileno=int(sys.argv[1])))
    main()
