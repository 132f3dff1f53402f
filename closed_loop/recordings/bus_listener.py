"""Decodes the frames on a bus as a listener: messages, and rejected frames counted by cause.

It decides as the nodes do (``dbc.messages.decode``, then the end-to-end counter), with the widest
window: a listener controls nothing, so it may accept any newer counter at any time. Of
authenticated frames it reads the payload only, because it has no key.

The decoded signals on one time base: a row for every message, with the newest of all signals.

    time_s, message, steering_command.steer_rad, ..., latency_config.loss

``time_s`` counts from the first frame of the log. Each row holds what a listener on the bus knew at
that time: the signals of its message are new, all others keep their last value. The signals of a
message are empty before its first frame. Enumerations are numbers, as in the DBC's value tables.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from importlib import import_module
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from ...dbc.codec.protection import (
    COUNTERS,
    HALF,
    PERIOD_NS_MIN,
    SequenceCheck,
    SequenceResult,
    SequenceRule,
)
from ...dbc.messages import (
    CAN_IDS,
    DATA_IDS,
    MESSAGE_TYPES,
    Decoded,
    LateralError,
    Message,
    Rejection,
    SteeringCommand,
    SteeringPlan,
    decode,
    resolutions,
)
from ...dbc.secoc.secured_frame import plain
from ...plant_emulator.steering.plan_buffer import planned_rad
from ...runtime.command_line import installation
from ...runtime.frame import ERROR, Frame
from ...runtime.settings import SettingsError

RULE = SequenceRule(lead_ns=HALF * PERIOD_NS_MIN, resync_run=20)
"""Accept whatever is newer, and a restart of the sender after 20 rejected counters in a row."""
FOREIGN_IDS_MAX = 1000
"""How many foreign identifiers are counted separately."""

NAMES: Mapping[type[Message], str] = {kind: name for name, kind in MESSAGE_TYPES.items()}
"""The name of each message in the DBC."""
_NAMES_BY_ID = {CAN_IDS[kind]: name for kind, name in NAMES.items()}


class ReceivedMessage(NamedTuple):
    """A message on the bus.

    ``counter``  end-to-end counter, 0 for a message without one
    ``is_late``  overtaken by a newer one: a node would reject it
    ``sample``   counter of the newest measurement before it, 0 before the first
    """

    name: str
    message: Message
    counter: int
    is_late: bool
    sample: int

    @property
    def shown(self) -> Message:
        """The message; in place of a plan the command that it is at the newest measurement."""
        if isinstance(self.message, SteeringPlan):
            return command_at(self.message, self.sample)
        return self.message


def command_at(message: SteeringCommand | SteeringPlan, sample: int) -> SteeringCommand:
    """Return a command, or what a plan commands at the sample with this end-to-end counter."""
    if isinstance(message, SteeringCommand):
        return message
    number, mode, first_sample, spacing, *steers_rad = message
    age = min((sample - first_sample) % COUNTERS, spacing * (len(steers_rad) - 1))
    return SteeringCommand(planned_rad(age, spacing, steers_rad), number, mode)


class MessageCounts(NamedTuple):
    """Frames under the identifier of one message.

    ``accepted``  intact, within range, newer than all before
    ``missing``   counters that the accepted frames skip; a late frame was skipped before it came,
                  so it is counted here too
    ``late``      older than the newest
    ``refused``   all others, by cause
    """

    accepted: int
    missing: int
    late: int
    refused: Mapping[str, int]


class BusListener:
    """Takes every frame on a bus, in order.

    ``foreign``         frames by identifier, for the first FOREIGN_IDS_MAX that the DBC lacks
    ``foreign_frames``  frames with an identifier that the DBC lacks
    ``error_frames``    which the listener's own CAN controller generates
    """

    def __init__(self) -> None:
        self._checks = {
            name: SequenceCheck(RULE, PERIOD_NS_MIN)
            for kind, name in NAMES.items()
            if kind in DATA_IDS  # others are sent by hand, so it has no counter
        }
        self._accepted = Counter[str]()
        self._late = Counter[str]()
        self._refused = {name: Counter[str]() for name in MESSAGE_TYPES}
        self.foreign = Counter[int]()
        self.foreign_frames = 0
        self.error_frames = 0
        self._sample = 0

    @property
    def refused(self) -> Mapping[str, int]:
        """Rejected frames under identifiers of the DBC, by cause."""
        total = Counter[str]()
        for counts in self._refused.values():
            total.update(counts)
        return dict(sorted(total.items()))

    def counts(self, name: str) -> MessageCounts:
        """Return the counts of the message called ``name`` in the DBC."""
        check = self._checks.get(name)
        return MessageCounts(
            self._accepted[name],
            0 if check is None else check.lost,
            self._late[name],
            dict(sorted(self._refused[name].items())),
        )

    def take(self, frame: Frame) -> ReceivedMessage | None:
        """Return the message in a frame; None for a rejected, foreign or duplicate frame."""
        decoded = decode(plain(frame))
        if isinstance(decoded, Decoded):
            message, counter = decoded
            name = NAMES[type(message)]
            result = self._in_sequence(name, counter)
            if result is SequenceResult.ACCEPTED:
                self._accepted[name] += 1
                if isinstance(message, LateralError):
                    self._sample = counter
                return ReceivedMessage(name, message, counter, False, self._sample)
            if result is SequenceResult.OUT_OF_ORDER:
                self._late[name] += 1
                return ReceivedMessage(name, message, counter, True, self._sample)
            self._refused[name][result.value] += 1
        elif frame.flags & ERROR:
            self.error_frames += 1
        elif decoded is Rejection.UNKNOWN_ID:
            self.foreign_frames += 1
            if frame.can_id in self.foreign or len(self.foreign) < FOREIGN_IDS_MAX:
                self.foreign[frame.can_id] += 1
        else:
            self._refused[_NAMES_BY_ID[frame.can_id]][decoded.value] += 1
        return None

    def _in_sequence(self, name: str, counter: int) -> SequenceResult:
        check = self._checks.get(name)
        return SequenceResult.ACCEPTED if check is None else check.check(counter)


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


class Export(Protocol):
    """A file that the messages of a log are written to."""

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:
        """Add a message: time in the log [ns], and time since its start [s]."""
        ...

    def close(self) -> None:
        """Write out what is still held back."""
        ...


class CsvTable:
    """Writes the table as CSV."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", newline="\n")
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
