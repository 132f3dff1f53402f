"""Recording of the frames of a program in a log format of python-can, off the control path.

    control path ── one non-blocking write ──► pipe (bounded) ──► recorder process ──► file

The recorder is a separate process, so that formatting, compressing and waiting for a disk share
neither interpreter nor priority with the control loop. Frames that do not fit into the pipe are not
recorded, but counted. The file is complete however the program ends, even if it is killed: the
recorder sees the end of the pipe and closes the file.

A frame's time is its arrival (if the port knows it, otherwise when the program read it) or when it
was handed to the bus. It is read from the monotonic clock and converted to wall-clock time with the
difference at the start, so that setting the clock leaves no gap in a recording.
"""

import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..frame import Frame
from ..node.real_time_loop import Port, Received

SUFFIXES = (".log", ".asc", ".blf")
"""The formats that have a place for every frame; ``.log`` is what ``candump -L`` writes."""
STOP_TIMEOUT_S = 30.0
"""How long the recorder may take to finish the file; the disk may stall."""
RECORD = struct.Struct("<qIB?Bx")
"""Head of a frame in the pipe: time [ns], identifier, flags, whether received, payload length."""
_PIPE_BYTES = 1 << 20
"""The largest pipe for an ordinary user: over 20 000 frames, 40 s of the loop at 100 Hz."""
_ENDED = "the recorder was ended before it could finish the file"


class RecordingFigures(NamedTuple):
    """Result of a recording.

    ``frames``    frames in the file; after a failure, those of which that is known
    ``dropped``   frames for which there was no room on the way to the recorder; after a failure,
                  all others
    ``failure``   why the recorder failed; empty if it did not
    """

    file: str
    frames: int
    dropped: int
    failure: str


class RecordingError(OSError):
    """The recorder cannot start; the text is one line for the user."""


def recording_obstacle(path: Path) -> str:
    """Why nothing can be recorded into a file of this name; empty when it can."""
    if sys.platform == "win32":
        return "nothing is recorded on Windows: its pipes wait, and so would the control loop"
    if path.suffix.lower() not in SUFFIXES:
        return f"{path}: records as {', '.join(SUFFIXES)} only, by the end of the name"
    return ""


class Recording:
    """The recording of one run; ``close`` it at the end.

    ``path``     file to write, replaced if it is there
    ``on_end``   called with the cause, once, when the recorder ends before ``close``

    ``recorder``  the process that writes

    Raises RecordingError when the recorder does not start, and OSError when the file cannot be
    written. To be made before a program asks for real-time priority, which the recorder would
    inherit.
    """

    def __init__(
        self, path: Path, channel: str, on_end: Callable[[str], None] = lambda _cause: None
    ) -> None:
        self._path = path
        self._on_end = on_end
        self._rest = b""
        self._offered = self._dropped = 0
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        program = [sys.executable, "-P", "-m", "steer_by_wire.runtime.recording.recorder_process"]
        self.recorder = subprocess.Popen(  # noqa: S603 the command is our own
            [*program, str(path), channel],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # what libraries have to say about themselves
            start_new_session=True,  # Ctrl-C is for this process; the recorder ends after it
        )
        pipe, answer = self.recorder.stdin, self.recorder.stdout
        if pipe is None or answer is None:
            raise RecordingError("the recorder has no pipe")
        try:
            first = answer.readline()
        except BaseException:  # Ctrl-C, where opening the file does not come to an end
            self.recorder.kill()
            self.recorder.wait()
            raise
        if first.strip() != b"ready":
            self.recorder.communicate()
            failure = _summary(first).get("failure") or "the recorder does not start"
            raise RecordingError(f"{path}: {failure}")
        self._pipe, self._answer = pipe, answer
        self._has_ended = False
        if sys.platform == "linux":
            import fcntl  # only Unix has it

            with suppress(OSError):  # over the limit of all pipes, it keeps the ordinary 64 KiB
                fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(pipe.fileno(), False)

    def record(self, frame: Frame, time_ns: int, *, is_received: bool) -> None:
        """Hand over one frame, in a few microseconds and without waiting.

        ``time_ns``  on the monotonic clock [ns]
        """
        can_id, data, flags = frame
        head = RECORD.pack(time_ns + self._offset_ns, can_id, flags, is_received, len(data))
        self._offered += 1
        if self._has_ended:
            self._dropped += 1
            return
        try:
            # At most PIPE_BUF bytes are written as a whole or not at all.
            os.write(self._pipe.fileno(), head + data)
        except BlockingIOError:  # the pipe is full
            self._dropped += 1
        except BrokenPipeError:
            self._dropped += 1
            self._end_early()

    def close(self) -> RecordingFigures:
        """Let the recorder finish the file."""
        with suppress(OSError):  # it has ended already, and reports why
            self._pipe.close()
        with self._answer:
            try:
                self.recorder.wait(STOP_TIMEOUT_S)
                self._rest += self._answer.read()
            except subprocess.TimeoutExpired:
                self.recorder.kill()
                self.recorder.wait()
        summary: dict[str, Any] = {"frames": 0, "failure": _ENDED}
        summary |= _summary(self._rest)
        if summary["failure"]:  # what was still in the pipe is lost too
            self._dropped = self._offered - summary["frames"]
        return RecordingFigures(str(self._path), dropped=self._dropped, **summary)

    def _end_early(self) -> None:
        """Report why the recorder has ended, and offer it nothing more."""
        self._has_ended = True
        self._rest = self._answer.read()  # it has ended, so this does not wait
        self._on_end(_summary(self._rest).get("failure") or _ENDED)


class RecordingPort:
    """A port that records what passes through it."""

    def __init__(
        self, port: Port, recording: Recording, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._port = port
        self._recording = recording
        self._clock_ns = clock_ns

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s]."""
        received = self._port.recv(timeout_s)
        if received is not None:
            frame, arrival_ns = received
            time_ns = self._clock_ns() if arrival_ns is None else arrival_ns
            self._recording.record(frame, time_ns, is_received=True)
        return received

    def send(self, frame: Frame) -> bool:
        """Hand ``frame`` to the bus without waiting; returns whether it had room."""
        time_ns = self._clock_ns()
        had_room = self._port.send(frame)
        if had_room:
            self._recording.record(frame, time_ns, is_received=False)
        return had_room


def _summary(line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
