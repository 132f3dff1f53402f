"""Process 1 inside a User Mode Linux: makes the interfaces, runs the command."""

import fcntl
import json
import os
import resource
import selectors
import signal
import sys
import termios
import tty
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from .guard import execute, reap
from .links import make_links
from .serial_frames import Kind, Unpacker, pack
from .system_calls import (
    MS_NODEV,
    MS_NOEXEC,
    MS_NOSUID,
    insert_module,
    mount,
    power_off,
    signal_descriptor,
)

LINE, STDIN_LINE = "/dev/ttyS0", "/dev/ttyS1"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
PIECE_BYTES = 16384


def main(folder: str) -> NoReturn:
    """Do the job that the wrapper has left in ``folder``, then switch off."""
    line = -1
    try:
        _mount_all()
        line, stdin_line = _open_line(LINE), _open_line(STDIN_LINE)
        job = json.loads((Path(folder) / "job.json").read_text(encoding="ascii"))
        for path, parameters in job["modules"]:
            insert_module(path, parameters)
        make_links(job["links"], PATH)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
        _write(line, pack(Kind.READY))
        _Command(job, line, stdin_line).run()
    except BaseException as error:  # the kernel panics when its first process ends
        if line >= 0:
            _write(line, pack(Kind.FAILED, (str(error) or type(error).__name__).encode()))
            _await_end(line)
    power_off()
    sys.exit(1)


class _Ends(NamedTuple):
    """Our ends of the command's standard streams; a terminal has one end and no ``stderr``."""

    stdin: int
    stdout: int
    stderr: int | None


class _Command:
    """The running command between its pipes and the serial lines."""

    def __init__(self, job: dict[str, Any], line: int, stdin_line: int) -> None:
        self._line, self._stdin_line = line, stdin_line
        self._control, self._input = Unpacker(), Unpacker()
        self._waiting, self._input_ended = b"", False
        self._status: int | None = None
        self._selector = selectors.DefaultSelector()
        self._pid, self._ends = _start(job)
        self._streams = {self._ends.stdout: Kind.STDOUT}
        if self._ends.stderr is not None:
            self._streams[self._ends.stderr] = Kind.STDERR
        os.set_blocking(self._ends.stdin, False)
        self._child_ends = signal_descriptor([signal.SIGCHLD])
        read = selectors.EVENT_READ
        self._selector.register(self._child_ends, read, self._reap)
        self._selector.register(line, read, self._obey)
        self._selector.register(stdin_line, read, self._take_input)
        for descriptor in self._streams:
            self._selector.register(descriptor, read, descriptor)

    def run(self) -> None:
        """Forward all streams until the command has ended, then send its status."""
        while self._status is None:
            for key, _ in self._selector.select():
                if callable(key.data):
                    key.data()
                else:
                    self._pass_output(key.data)
        # Processes that still hold a pipe end with the command, or the streams would not end.
        with suppress(ProcessLookupError):
            os.kill(-1, signal.SIGKILL)
        for descriptor in list(self._streams):
            while self._pass_output(descriptor):
                pass
        os.sync()
        _write(self._line, pack(Kind.STATUS, b"%d" % self._status))
        _await_end(self._line)

    def _reap(self) -> None:
        os.read(self._child_ends, 4096)
        self._status = reap().get(self._pid)

    def _pass_output(self, descriptor: int) -> bool:
        try:
            piece = os.read(descriptor, PIECE_BYTES)
        except BlockingIOError:
            return True
        except OSError:  # a terminal signals its end by an error
            piece = b""
        if piece:
            _write(self._line, pack(self._streams[descriptor], piece))
        else:
            self._forget(descriptor)
        return bool(piece)

    def _forget(self, descriptor: int) -> None:
        if self._streams.pop(descriptor, None) is not None:
            self._selector.unregister(descriptor)
            os.close(descriptor)

    def _obey(self) -> None:
        piece = os.read(self._line, PIECE_BYTES)
        if not piece:
            power_off()  # the wrapper has ended
        for kind, content in self._control.feed(piece):
            if kind is Kind.SIGNAL:
                with suppress(ProcessLookupError):
                    os.killpg(self._pid, int(content))
            elif kind is Kind.SIZE:
                with suppress(OSError):
                    fcntl.ioctl(self._ends.stdin, termios.TIOCSWINSZ, content)
            elif kind is Kind.CLOSED:
                stream = Kind(int(content))
                for descriptor in [d for d, s in self._streams.items() if s is stream]:
                    self._forget(descriptor)

    def _take_input(self) -> None:
        for frame in self._input.feed(os.read(self._stdin_line, PIECE_BYTES)):
            self._waiting += frame.content
            self._input_ended |= not frame.content
        self._selector.unregister(self._stdin_line)
        self._selector.register(self._ends.stdin, selectors.EVENT_WRITE, self._feed)

    def _feed(self) -> None:
        """Write input to the command; the line is read again only when all has been written."""
        try:
            self._waiting = self._waiting[os.write(self._ends.stdin, self._waiting) :]
        except BlockingIOError:
            return
        except BrokenPipeError:  # the command has closed its input
            self._waiting, self._input_ended = b"", True
        if self._waiting:
            return
        self._selector.unregister(self._ends.stdin)
        if self._input_ended:
            os.close(self._ends.stdin)
        else:
            self._selector.register(self._stdin_line, selectors.EVENT_READ, self._take_input)


def _mount_all() -> None:
    mount("proc", "/proc", MS_NOSUID | MS_NODEV | MS_NOEXEC)
    mount("sysfs", "/sys", MS_NOSUID | MS_NODEV | MS_NOEXEC)
    for folder in ("/dev/pts", "/dev/shm"):  # noqa: S108 the place, not a file in it
        os.makedirs(folder, exist_ok=True)
    mount("devpts", "/dev/pts", MS_NOSUID | MS_NOEXEC, "gid=5,mode=620,ptmxmode=666")
    mount("tmpfs", "/dev/shm", MS_NOSUID | MS_NODEV, "mode=1777")  # noqa: S108
    for name, target in {"fd": "fd", "stdin": "fd/0", "stdout": "fd/1", "stderr": "fd/2"}.items():
        with suppress(FileExistsError):
            os.symlink(f"/proc/self/{target}", f"/dev/{name}")


def _open_line(path: str) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    tty.setraw(descriptor)
    return descriptor


def _start(job: dict[str, Any]) -> tuple[int, _Ends]:
    """Start the command as its user; returns its process and our ends of its streams."""
    if job["terminal"]:
        ours, theirs = os.openpty()
        given, ends = (theirs, theirs, theirs), _Ends(os.dup(ours), ours, None)
    else:
        stdin, stdout, stderr = os.pipe(), os.pipe(), os.pipe()
        given, ends = (stdin[0], stdout[1], stderr[1]), _Ends(stdin[1], stdout[0], stderr[0])
    pid = os.fork()
    if pid == 0:
        try:
            for number, theirs in enumerate(given):
                os.dup2(theirs, number)
            os.setsid()
            if job["terminal"]:
                fcntl.ioctl(0, termios.TIOCSCTTY, 0)
            _become(job)
            execute(job["command"], job["environment"])
        except BaseException as error:  # nothing may leave a forked process
            print(f"with-vcan: error: {error}", file=sys.stderr, flush=True)
        finally:
            os._exit(126)
    for descriptor in set(given):
        os.close(descriptor)
    return pid, ends


def _become(job: dict[str, Any]) -> None:
    """Take on the limits, user and folder of the wrapper."""
    os.umask(job["file_mask"])
    for number, limits in job["limits"].items():
        with suppress(OSError, ValueError):  # kernels differ in the limits that they know and allow
            resource.setrlimit(int(number), tuple(limits))
    runtime = job["environment"].get("XDG_RUNTIME_DIR", "")
    os.setgroups(job["groups"])
    os.setresgid(job["group"], job["group"], job["group"])
    os.setresuid(job["user"], job["user"], job["user"])
    os.chdir(job["folder"])
    if runtime and not os.path.isdir(runtime):
        del job["environment"]["XDG_RUNTIME_DIR"]


def _write(descriptor: int, content: bytes) -> None:
    while content:
        content = content[os.write(descriptor, content) :]


def _await_end(line: int) -> None:
    """Wait until the wrapper has read everything and closes the line."""
    while os.read(line, PIECE_BYTES):
        pass
