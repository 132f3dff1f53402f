"""Starts our programs by forking an interpreter that has imported their libraries already.

For User Mode Linux, in which a system call and a page fault take tens of microseconds: there a
program that is started as usual imports for two seconds. Elsewhere programs start as usual.

A forked program is a child of the one that asked for it, like any other: it is waited for, signals
reach it, its memory and files are its own, and it ends with all that the interpreter does at an
end. Only the modules that are imported already and the seed of hashes are those of its origin.
"""

import atexit
import gc
import inspect
import json
import os
import runpy
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from steer_by_wire.vcan.system_calls import adopt_orphans

ROOT = Path(__file__).resolve().parents[2]
FORKED = ("steer_by_wire.", "cantools")
STREAMS = 3
PRELOADED = (
    "can",
    "can.interfaces.socketcan",
    "steer_by_wire.controller.program",
    "steer_by_wire.plant_emulator.program",
    "steer_by_wire.runtime.attached",
)
REQUEST_BYTES_MAX = 1 << 17
_PIPES = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")


class Request(NamedTuple):
    """What to run, and where; the standard streams come along with it."""

    module: str
    arguments: list[str]
    is_folder_searched: bool
    folder: str
    has_own_session: bool


@contextmanager
def forked_programs() -> Iterator[None]:
    """Have this process's ``subprocess`` fork our programs, where it can, during the block."""
    adopt_orphans()
    usual = subprocess.Popen._execute_child  # type: ignore[attr-defined]
    signature = inspect.signature(usual)
    line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    code = f"from {__name__} import serve; serve({theirs.fileno()})"
    command = [sys.executable, "-c", code]
    with theirs:
        origin = subprocess.Popen(command, cwd=ROOT, pass_fds=[theirs.fileno()])

    def start(*arguments: Any) -> None:
        given = signature.bind(*arguments).arguments
        request = _request(given)
        if request is None:
            usual(*arguments)
            return
        streams = [given[name] for name in ("p2cread", "c2pwrite", "errwrite")]
        inherited = [at if at >= 0 else number for number, at in enumerate(streams)]
        socket.send_fds(line, [json.dumps(request).encode()], inherited)
        process = given["self"]
        process.pid = int(line.recv(REQUEST_BYTES_MAX))
        process._child_created = True
        process._close_pipe_fds(*(given[name] for name in _PIPES))

    subprocess.Popen._execute_child = start  # type: ignore[attr-defined]
    with origin, line:
        yield
        subprocess.Popen._execute_child = usual  # type: ignore[attr-defined]


def _request(given: Mapping[str, Any]) -> Request | None:
    """Return what is to be forked, or None for what must start as usual."""
    unusual = ("executable", "preexec_fn", "env", "shell", "gid", "gids", "uid")
    words = given["args"]
    if any(given[name] for name in (*unusual, "pass_fds")) or isinstance(words, str):
        return None
    interpreter, *words = map(os.fspath, words)
    is_searched = words[:1] != ["-P"]
    words = words[not is_searched :]
    if interpreter != sys.executable or words[:1] != ["-m"] or not words[1].startswith(FORKED):
        return None
    folder = os.path.abspath(given["cwd"] or os.getcwd())
    return Request(words[1], words[2:], is_searched, folder, given["start_new_session"])


def serve(descriptor: int) -> None:
    """Fork for each request, until the one who asks has gone."""
    sys.path.remove("")
    for name in PRELOADED:
        import_module(name)
    gc.collect()
    gc.freeze()  # a collection in a forked program would copy all these pages
    with socket.socket(fileno=descriptor) as line:
        while True:
            content, streams, _, _ = socket.recv_fds(line, REQUEST_BYTES_MAX, STREAMS)
            if not content:
                return
            line.send(b"%d" % _fork(Request(*json.loads(content)), streams))
            for stream in streams:
                os.close(stream)


def _fork(request: Request, streams: list[int]) -> int:
    """Fork twice, which leaves an orphan for the one who asks to adopt; returns its process."""
    reading, writing = os.pipe()
    between = os.fork()
    if not between:
        program = os.fork()
        if not program:
            _run(request, streams)
        os.write(writing, b"%d" % program)
        os._exit(0)
    os.close(writing)
    with open(reading, "rb") as said:
        os.waitpid(between, 0)
        return int(said.read(20))


def _run(request: Request, streams: list[int]) -> NoReturn:
    """Become the program; at its end do what an interpreter does, but do not free its memory."""
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    os.closerange(STREAMS, max(streams) + 64)
    sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(1, "w")
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace")
    if request.has_own_session:
        os.setsid()
    os.chdir(request.folder)
    if request.is_folder_searched:
        sys.path.insert(0, request.folder)
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
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
