"""Writes the signals of a log as CSV or Parquet: a row for every message, with the newest of all.

    time_s, message, steering_command.steer_rad, ..., latency_config.loss

``time_s`` counts from the first frame of the log. Each row holds what a listener on the bus knew at
that time: the signals of its message are new, all others keep their last value. The signals of a
message are empty before its first frame. Enumerations are numbers, as in the DBC's value tables.
"""

from collections.abc import Callable
from importlib import import_module
from itertools import accumulate
from pathlib import Path
from typing import Any

from ...closed_loop.recordings.bus_listener import ReceivedMessage
from ...dbc.messages import MESSAGE_TYPES, resolutions
from ...runtime.command_line import installation
from ...runtime.output_file import open_text
from ...runtime.settings import SettingsError

ROWS_PER_GROUP = 50_000
"""Rows that are kept until they are written as one part of a Parquet file."""

_ENDS = accumulate(len(kind._fields) for kind in MESSAGE_TYPES.values())
PLACES = {
    name: slice(end - len(kind._fields), end)
    for (name, kind), end in zip(MESSAGE_TYPES.items(), _ENDS, strict=True)
}
"""Where the signals of each message are among the columns of signals."""
COLUMNS = tuple(
    f"{name.lower()}.{field}" for name, kind in MESSAGE_TYPES.items() for field in kind._fields
)


class MissingLibraryError(SettingsError):
    """An optional library is not installed; the text is one line for the user."""


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


class ParquetTable:
    """Writes the table as Parquet; raises MissingLibraryError without pyarrow."""

    def __init__(self, path: Path) -> None:
        try:
            arrow: Any = import_module("pyarrow")
            parquet: Any = import_module("pyarrow.parquet")
        except ImportError as error:
            raise MissingLibraryError(
                f"Parquet needs pyarrow: {installation('pyarrow')}"
            ) from error
        self._arrow = arrow
        fields = [("time_s", arrow.float64()), ("message", arrow.string())]
        self._schema = arrow.schema(fields + [(name, arrow.float64()) for name in COLUMNS])
        self._writer: Any = parquet.ParquetWriter(path, self._schema)
        self._newest: list[float | None] = [None] * len(COLUMNS)
        self._rows: list[tuple[Any, ...]] = []

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:  # noqa: ARG002
        """Add a message."""
        self._newest[PLACES[received.name]] = map(float, received.message)
        self._rows.append((at_s if at_s == at_s else None, received.name, *self._newest))
        if len(self._rows) >= ROWS_PER_GROUP:
            self._write_group()

    def close(self) -> None:
        """Write out what is still held back."""
        self._write_group()
        self._writer.close()

    def _write_group(self) -> None:
        columns = list(zip(*self._rows, strict=True)) or [()] * len(self._schema)
        arrays = [
            self._arrow.array(column, type=field.type)
            for column, field in zip(columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._rows.clear()


def _formats(name: str) -> list[Callable[[float], str]]:
    return [
        _whole if resolution >= 1.0 else f"{{:.{_digits(resolution)}f}}".format
        for resolution in resolutions(MESSAGE_TYPES[name]).values()
    ]


def _whole(value: float) -> str:
    return str(int(value))


def _digits(resolution: float) -> int:
    return next(digits for digits in range(1, 16) if round(resolution, digits) == resolution)
