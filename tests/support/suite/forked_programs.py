"""Starts our programs by forking an interpreter that has imported their libraries already.

A program that is started as usual imports for a third of a second, in User Mode Linux for two
seconds, and the tests start hundreds.

A forked program is a child of the one that asked for it, like any other: it is waited for, signals
reach it, its memory and files are its own, and it ends with all that the interpreter does at an
end. Only the modules that are imported already and the seed of hashes are those of its origin.

What a forked program starts itself is forked from it, and first forgets what is not inherited by a
program: handlers of signals, what is to be done at the end, open files.
"""

import atexit
import gc
import inspect
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.thread import _threads_queues
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module, metadata
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from steer_by_wire.with_vcan.system_calls import adopt_orphans

ROOT = Path(__file__).resolve().parents[3]
FORKED = ("steer_by_wire", "can", "cantools", "pytest", "tests")
STREAMS = (0, 1, 2)
PRELOADED = (
    "can",
    "can.interfaces.socketcan",
    "cantools.subparsers.plot",
    "steer_by_wire.controller.command_line.program",
    "steer_by_wire.plant_emulator.command_line.program",
    "steer_by_wire.closed_loop.processes.ends_with_parent",
    "steer_by_wire.runtime.emulated_bus.interface",
    "steer_by_wire.runtime.recording.recorder_process",
    "steer_by_wire.tools.bus.program",
)
REQUEST_BYTES_MAX = 1 << 17
DESCRIPTORS_MAX = 16
AT_START = ("PYTHON", "OPENBLAS_", "NPY_", "OMP_", "LD_", "MPL")
"""Variables of the environment that an interpreter and libraries only read when they start.

numba's are not among them: it is imported by the program.
"""
_USUAL = subprocess.Popen._execute_child
_PIPES = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
_PATH: list[str] = []
"""Where an interpreter searches for modules, apart from its folder."""
_FINDERS: list[Any] = []
"""How it searches; a pytest adds one of its own, which ``runpy`` cannot use."""
_ABANDONED: list[Any] = []
"""A parent's streams: freed, they would write what it has not written yet, and close."""


class Request(NamedTuple):
    """What to run, and where.

    ``passed``  numbers of the descriptors that come along behind the standard streams
    """

    module: str
    arguments: list[str]
    is_folder_searched: bool
    folder: str
    environment: dict[str, str]
    has_own_session: bool
    passed: list[int]


@contextmanager
def forked_programs() -> Iterator[None]:
    """Have this process's ``subprocess`` fork our programs, where it can, during the block."""
    lock = threading.Lock()
    end = ExitStack()

    @cache
    def origin() -> socket.socket:
        """Start it when it is first needed; returns the line to it."""
        adopt_orphans()
        line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        code = f"from {__name__} import serve; serve({theirs.fileno()})"
        with theirs:
            command = [sys.executable, "-c", code]
            end.enter_context(subprocess.Popen(command, cwd=ROOT, pass_fds=[theirs.fileno()]))
        return end.enter_context(line)

    def ask(request: Request, descriptors: Sequence[int]) -> int:
        with lock:
            socket.send_fds(origin(), [json.dumps(request).encode()], descriptors)
            return int(origin().recv(REQUEST_BYTES_MAX))

    subprocess.Popen._execute_child = _starting(ask)
    with end:
        yield
        subprocess.Popen._execute_child = _USUAL


def _starting(fork: Callable[[Request, Sequence[int]], int]) -> Callable[..., None]:
    """Return a method of ``Popen`` that has ``fork`` start our programs; all others as usual."""
    signature = inspect.signature(_USUAL)
    started_with = _at_start(os.environ)

    def start(*arguments: Any) -> None:
        given = signature.bind(*arguments).arguments
        request = _request(given)
        if request is None or _at_start(request.environment) != started_with:
            _USUAL(*arguments)
            return
        streams = [given[name] for name in ("p2cread", "c2pwrite", "errwrite")]
        inherited = [at if at >= 0 else number for number, at in zip(STREAMS, streams, strict=True)]
        process = given["self"]
        process.pid = fork(request, [*inherited, *request.passed])
        process._child_created = True
        process._close_pipe_fds(*(given[name] for name in _PIPES))

    return start


def _request(given: Mapping[str, Any]) -> Request | None:
    """Return what is to be forked, or None for what must start as usual."""
    unusual = ("executable", "preexec_fn", "shell", "gid", "gids", "uid")
    words = given["args"]
    is_unusual = any(given[name] for name in unusual) or given["umask"] >= 0
    if is_unusual or isinstance(words, str):
        return None
    interpreter, *words = map(os.fspath, words)
    is_searched = words[:1] != ["-P"]
    words = words[not is_searched :]
    if interpreter != sys.executable or words[:1] != ["-m"] or not words[1].startswith(FORKED):
        return None
    folder = os.path.abspath(given["cwd"] or os.getcwd())
    environment = dict(os.environ if given["env"] is None else given["env"])
    has_own_session, passed = given["start_new_session"], list(given["pass_fds"])
    return Request(words[1], words[2:], is_searched, folder, environment, has_own_session, passed)


def _at_start(environment: Mapping[str, str]) -> dict[str, str]:
    return {name: text for name, text in environment.items() if name.startswith(AT_START)}


def serve(descriptor: int) -> None:
    """Fork for each request, until the one who asks has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C at the terminal reaches it too
    sys.path.remove("")
    sys.modules["matplotlib"] = None  # for cantools' command "plot"
    metadata.entry_points = cache(metadata.entry_points)  # as in conftest
    for name in PRELOADED:
        import_module(name)
    del sys.modules["matplotlib"]
    _PATH.extend(sys.path)
    _FINDERS.extend(sys.meta_path)
    gc.collect()
    gc.freeze()  # a collection in a forked program would copy all these pages
    with socket.socket(fileno=descriptor) as line:
        while True:
            content, streams, _, _ = socket.recv_fds(line, REQUEST_BYTES_MAX, DESCRIPTORS_MAX)
            if not content:
                return
            line.send(b"%d" % _fork_orphan(Request(*json.loads(content)), streams))
            for stream in streams:
                os.close(stream)


def _fork_orphan(request: Request, descriptors: Sequence[int]) -> int:
    """Fork twice, which leaves an orphan for the one who asks to adopt; returns its process."""
    reading, writing = os.pipe()
    between = os.fork()
    if not between:
        program = os.fork()
        if not program:
            _run(request, descriptors)
        os.write(writing, b"%d" % program)
        os._exit(0)
    os.close(writing)
    with open(reading, "rb") as said:
        os.waitpid(between, 0)
        return int(said.read(20))


def _fork_child(request: Request, descriptors: Sequence[int]) -> int:
    """Fork a child of this program; returns its process."""
    program = os.fork()
    if not program:
        atexit._clear()
        # At its end it would wait for threads that it lacks, and for itself.
        _threads_queues.clear()
        gc.enable()
        gc.freeze()
        signal.set_wakeup_fd(-1)
        for number in signal.valid_signals():
            if callable(signal.getsignal(number)):
                signal.signal(number, signal.SIG_DFL)
        _run(request, descriptors)
    return program


def _run(request: Request, descriptors: Sequence[int]) -> NoReturn:
    """Become the program; at its end do what an interpreter does, but do not free its memory."""
    _ABANDONED.extend((sys.stdin, sys.stdout, sys.stderr))
    _place(descriptors, [*STREAMS, *request.passed])
    sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(1, "w")
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace")
    if request.has_own_session:
        os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(request.folder)
    os.environ.clear()
    os.environ.update(request.environment)
    sys.path[:] = [request.folder, *_PATH] if request.is_folder_searched else _PATH
    sys.meta_path[:] = _FINDERS
    subprocess.Popen._execute_child = _starting(_fork_child)
    sys.modules.pop(request.module, None)  # runpy warns of what has run already
    sys.argv = [request.module, *request.arguments]
    status = 1
    try:
        runpy.run_module(request.module, run_name="__main__", alter_sys=True)
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else bool(end.code)
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
    except BaseException:
        traceback.print_exc()
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _place(descriptors: Sequence[int], numbers: Sequence[int]) -> None:
    """Give the descriptors these numbers, and close all others."""
    import fcntl  # only Unix has it, and who forks is on Unix

    above = max(*descriptors, *numbers) + 1
    moved = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, above) for descriptor in descriptors]
    for descriptor, number in zip(moved, numbers, strict=True):
        os.dup2(descriptor, number)
    for before, after in pairwise([*sorted(numbers), os.sysconf("SC_OPEN_MAX")]):
        os.closerange(before + 1, after)
