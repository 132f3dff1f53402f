"""Signals of a log as CSV: a row for every message, with the newest of all.

    time_s, message, steering_command.steer_rad, ..., latency_config.loss

``time_s`` counts from the first frame of the log. Each row holds what a listener on the bus knew at
that time: the signals of its message are new, all others keep their last value. The signals of a
message are empty before its first frame. Enumerations are numbers, as in the DBC's value tables.
A car's messages have the signals, names and units of its database: ``LANE.OFFSET``.
"""

from collections.abc import Sequence
from pathlib import Path

from ...closed_loop.recordings.log_analysis import LoggedMessages
from ...dbc.listening import Listening
from ...dbc.messages import MESSAGE_TYPES
from ...runtime.output_file import open_text


class CsvTable:
    """Writes the table as CSV, of the messages that are on the bus."""

    def __init__(self, path: Path, listening: Listening) -> None:
        self._listening, self._columns = listening, list[str]()
        self._places = dict[str, slice]()
        for name in listening.listed:
            begin = len(self._columns)
            of_car = listening.car_messages.get(name)
            fields = of_car.signals if of_car else MESSAGE_TYPES[name]._fields
            first = name if of_car else name.lower()
            self._columns += [f"{first}.{field}" for field in fields]
            self._places[name] = slice(begin, len(self._columns))
        self._file = open_text(path)
        self._file.write(",".join(("time_s", "message", *self._columns)) + "\n")
        self._cells = [""] * len(self._columns)

    def write(self, taken: LoggedMessages) -> None:
        """Add the messages of ours, or the one of a car that stands for them."""
        if not taken.of_car:
            for received in taken.messages:
                self._add(taken.at_s, received.name, [f"{one:.10g}" for one in received.message])
            return
        message = self._listening.car_messages[taken.of_car]
        values = message.values(taken.frame.data)
        newest = self._cells[self._places[taken.of_car]]
        cells = [
            f"{values[signal]:.10g}" if signal in values else cell  # multiplexed
            for signal, cell in zip(message.signals, newest, strict=True)
        ]
        self._add(taken.at_s, taken.of_car, cells)

    def _add(self, at_s: float, name: str, cells: Sequence[str]) -> None:
        self._cells[self._places[name]] = cells
        time_text = f"{at_s:.6f}" if at_s == at_s else ""  # NaN in a log without times
        self._file.write(f"{time_text},{name},{','.join(self._cells)}\n")

    def close(self) -> None:
        """Write out what is still held back."""
        self._file.close()
