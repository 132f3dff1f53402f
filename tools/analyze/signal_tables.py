"""Writes the signals of a log as CSV: a row for every message, with the newest of all.

    time_s, message, steering_command.steer_rad, ..., latency_config.loss

``time_s`` counts from the first frame of the log. Each row holds what a listener on the bus knew at
that time: the signals of its message are new, all others keep their last value. The signals of a
message are empty before its first frame. Enumerations are numbers, as in the DBC's value tables.
"""

from collections.abc import Callable
from itertools import accumulate
from pathlib import Path

from ...closed_loop.recordings.bus_listener import ReceivedMessage
from ...dbc.messages import MESSAGE_TYPES, resolutions
from ...runtime.output_file import open_text

_ENDS = accumulate(len(kind._fields) for kind in MESSAGE_TYPES.values())
PLACES = {
    name: slice(end - len(kind._fields), end)
    for (name, kind), end in zip(MESSAGE_TYPES.items(), _ENDS, strict=True)
}
"""Where the signals of each message are among the columns of signals."""
COLUMNS = tuple(
    f"{name.lower()}.{field}" for name, kind in MESSAGE_TYPES.items() for field in kind._fields
)


class CsvTable:
    """Writes the table as CSV."""

    def __init__(self, path: Path) -> None:
        self._file = open_text(path)
        self._file.write(",".join(("time_s", "message", *COLUMNS)) + "\n")
        self._cells = [""] * len(COLUMNS)
        self._formats = {name: _formats(name) for name in MESSAGE_TYPES}

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:  # noqa: ARG002
        """Add a message."""
        formats = self._formats[received.name]
        self._cells[PLACES[received.name]] = [
            form(value) for form, value in zip(formats, received.message, strict=True)
        ]
        time_text = f"{at_s:.6f}" if at_s == at_s else ""  # NaN in a log without times
        self._file.write(f"{time_text},{received.name},{','.join(self._cells)}\n")

    def close(self) -> None:
        """Write out what is still held back."""
        self._file.close()


def _formats(name: str) -> list[Callable[[float], str]]:
    return [
        _whole if resolution >= 1.0 else f"{{:.{_digits(resolution)}f}}".format
        for resolution in resolutions(MESSAGE_TYPES[name]).values()
    ]


def _whole(value: float) -> str:
    return str(int(value))


def _digits(resolution: float) -> int:
    return next(digits for digits in range(1, 16) if round(resolution, digits) == resolution)
