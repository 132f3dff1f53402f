"""A recording as one block of data that a page plays: rows, changes of the lights, frame lists.

    block    gzip of: length of the head u32 (little-endian), head (JSON), rows as in ``signals``

A long recording has fewer rows a second, and says so; its running figures are still those of every
frame.
"""

import gzip
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...closed_loop.recordings.log_file import open_log
from ...closed_loop.recordings.logged import LogError
from ...closed_loop.recordings.status_lights import Light
from ...closed_loop.reports.law_colours import LawLine, law_lines
from ...dbc.listening import OUR_MESSAGES, Listening
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .lanes import lane_facts
from .sampler import Sampler
from .signals import ROW_PERIOD_S, packed_row, packed_rows, shown

ROWS_MAX = 100_000
"""Half an hour at the rate of a live page."""
_FRAME_LISTS_MAX = 600
_FRAME_LIST_S = 0.5
_LIGHT_CHANGES_MAX = 20_000


def read_replay(
    files: Sequence[Path], channel: str | None = None, listening: Listening = OUR_MESSAGES
) -> bytes:
    """Return the block of one recording, which may be several files; raises LogError."""
    replay = _Replay(listening)
    for file in files:
        log = open_log(file)
        for time_ns, its_channel, frame in log:
            if channel in (None, its_channel):
                replay.on_frame(file, time_ns, frame)
        if log.cut_off:
            replay.cut_off = f", cut off: {file.name}: {log.cut_off}"
    if replay.start_ns is None:
        raise LogError(f"{files[0]}: no frame of this channel")
    names = ", ".join(file.name for file in files)
    (line,) = law_lines([replay.law.lower()])
    facts, rows = replay.lane(replay.law or names, line)
    head = {
        "kind": "replay",
        **shown(),
        "lanes": [facts],
        "bus": f"recording {names}{replay.cut_off}",
        **{key: facts[key] for key in ("row_period_s", "duration_s")},
    }
    text = json.dumps(head, separators=(",", ":"), allow_nan=False).encode()
    return gzip.compress(struct.pack("<I", len(text)) + text + rows, mtime=0)


class _Thinned:
    """Things at a fixed period, every second of which is dropped when there are too many."""

    def __init__(self, period_s: float, most: int) -> None:
        self.period_ns = round(period_s * NS_PER_S)
        self.items: list[Any] = []
        self._most = most

    @property
    def due_ns(self) -> int:
        return len(self.items) * self.period_ns

    def add(self, item: Any) -> None:
        self.items.append(item)
        if len(self.items) >= self._most:
            self.items = self.items[::2]
            self.period_ns *= 2


class _Replay:
    """One recording.

    ``law``       that its controller reported last
    ``cut_off``   what ended it before its time
    ``start_ns``  time of its first frame; None without one
    """

    def __init__(self, listening: Listening) -> None:
        self.cut_off = ""
        self._sampler = Sampler(0, listening=listening)
        self.start_ns: int | None = None
        self._now_ns = 0
        self._rows = _Thinned(ROW_PERIOD_S, ROWS_MAX)
        self._frame_lists = _Thinned(_FRAME_LIST_S, _FRAME_LISTS_MAX)
        self._lights: list[tuple[float, Sequence[Light]]] = []

    def on_frame(self, file: Path, time_ns: int | None, frame: Frame) -> None:
        """Take one frame; raises LogError for one without a time."""
        if time_ns is None:
            raise LogError(f"{file}: has no times, which a replay needs")
        if self.start_ns is None:
            self.start_ns = time_ns
        # A clock that was set back stands still here.
        now_ns = max(time_ns - self.start_ns, self._now_ns)
        self._leave(now_ns)
        self._now_ns = now_ns
        self._sampler.on_frame(frame, now_ns)

    @property
    def law(self) -> str:
        """The law that steers at the end; empty where it is not known."""
        return self._sampler.law(self._now_ns)

    def lane(self, label: str, line: LawLine) -> tuple[Mapping[str, Any], bytes]:
        """Return facts and rows of the whole recording."""
        self._leave(self._now_ns + 1)
        end_s = self._now_ns / NS_PER_S
        self._rows.items.append(packed_row(end_s, self._sampler.row(self._now_ns)))
        facts = {
            **lane_facts(label, line)._asdict(),
            "row_period_s": self._rows.period_ns / NS_PER_S,
            "duration_s": end_s,
            "lights": [
                [at_s, [light._asdict() for light in lights]] for at_s, lights in self._lights
            ],
            "frame_list_s": self._frame_lists.period_ns / NS_PER_S,
            "frame_lists": self._frame_lists.items,
        }
        return facts, packed_rows(0, self._rows.items)

    def _leave(self, now_ns: int) -> None:
        """Leave all rows and lists that are due before ``now_ns``."""
        while self._rows.due_ns < now_ns:
            due_ns = self._rows.due_ns
            self._note_lights(due_ns)
            self._rows.add(packed_row(due_ns / NS_PER_S, self._sampler.row(due_ns)))
        while self._frame_lists.due_ns < now_ns:
            self._frame_lists.add(self._sampler.frames(self._frame_lists.due_ns))

    def _note_lights(self, now_ns: int) -> None:
        lights = self._sampler.lights(now_ns)
        is_new = not self._lights or self._lights[-1][1] != lights
        if is_new and len(self._lights) < _LIGHT_CHANGES_MAX:
            self._lights.append((now_ns / NS_PER_S, lights))
