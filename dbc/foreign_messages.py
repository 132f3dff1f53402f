"""Messages of any database that cantools reads, as traffic: identifier, length, cycle time, sender.

The databases of other people's vehicles: their signals are not decoded here.
"""

import logging
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..runtime.exit_status import one_line
from ..runtime.frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, EXTENDED, FD
from ..runtime.frame.length_with_stuff_bits import padded_length
from ..runtime.input_file import bounded, read_bytes
from ..runtime.settings import SettingsError
from ..runtime.settings.settings import encoding_of

if TYPE_CHECKING:
    from cantools.database.can import Database, Message

_BINARY = re.compile("[\0-\x08\x0e-\x19\x1b-\x1f]")
"""What no text has; DOS ended a file with \\x1a."""
CYCLE_MS_MIN, CYCLE_MS_MAX = 0.05, 1e7
"""From less than a frame takes at 1 Mbit/s to some hours [ms]."""


class ListedMessage(NamedTuple):
    """One message of a database.

    ``flags``     format, as in ``runtime.frame``
    ``length``    payload as sent, in FD frames filled up to a length that these have [bytes]
    ``cycle_ms``  cycle time; None for a message that is sent on events [ms]
    """

    name: str
    can_id: int
    flags: int
    length: int
    cycle_ms: float | None
    senders: tuple[str, ...]

    @property
    def fits_a_frame(self) -> bool:
        """Whether one frame holds it: not so for a long message of J1939."""
        return self.length <= CLASSIC_LENGTH_MAX or bool(self.flags & FD)


def read_message_set(path: Path) -> tuple[ListedMessage, ...]:
    """Read a database of one bus; raises SettingsError.

    ``path``  the file; one with several buses is followed by a colon and the name of one
    """
    file, bus = file_and_bus(path)
    messages = load_database(file).messages
    buses = sorted({message.bus_name for message in messages if message.bus_name})
    if bus not in buses and (bus or len(buses) > 1):
        raise SettingsError(
            f"{file}: holds the messages of the buses {', '.join(buses) or 'without names'}, which"
            f" do not wait for each other: choose one, as {file}:{(buses or ['NAME'])[0]}"
        )
    try:
        return tuple(_listed(one) for one in messages if not bus or one.bus_name == bus)
    except SettingsError as error:
        raise SettingsError(f"{file}: {error}") from error


def file_and_bus(path: Path) -> tuple[Path, str]:
    """Return the file of a database, and the bus that is chosen in it; empty for its only one."""
    file, colon, bus = str(path).rpartition(":")
    return (Path(file), bus) if colon and not path.exists() else (path, "")


def load_database(path: Path) -> "Database":
    """Read a database with any byte order mark; raises SettingsError."""
    import cantools.database  # not before there is a database: every run imports this module
    import textparser

    # It warns of identifiers that come twice, which callers refuse in a line of their own.
    logging.getLogger("cantools").addHandler(logging.NullHandler())
    try:
        raw = read_bytes(path)
    except OSError as error:
        raise SettingsError(f"{path}: {error.strerror}") from error
    if not raw:
        raise SettingsError(f"{path}: is empty")
    kind = path.suffix.lower().removeprefix(".")
    encoding = encoding_of(raw)
    if encoding == "utf-8" and kind in {"dbc", "sym"}:  # as Vector's and PEAK's tools write them
        encoding = "cp1252"
    text = raw.decode(encoding, errors="replace")
    if _BINARY.search(text):
        raise SettingsError(f"{path}: is a binary file, no database of CAN messages")
    with bounded(path):
        try:
            database = cantools.database.load_string(
                text, kind if kind in {"arxml", "dbc", "kcd", "sym"} else None, strict=False
            )
        except Exception as error:  # cantools raises more than its own for a damaged file
            if any(isinstance(one, MemoryError) for one in (error, *vars(error).values())):
                raise MemoryError from None  # a signal of millions of bits
            found = [one for one in vars(error).values() if isinstance(one, Exception)]
            inner = found[0] if len(found) == 1 else error
            cause = one_line(inner)
            if not isinstance(inner, cantools.database.errors.Error | textparser.Error):
                cause = f"a line or number that the format does not have ({cause})"
            what = f"no {kind and f'.{kind} '}file that cantools reads: {cause}"
            raise SettingsError(f"{path}: {what}; save it again with its editor") from error
    if not isinstance(database, cantools.database.Database):
        raise SettingsError(f"{path}: not a database of CAN messages")
    for message in database.messages:
        flags = [one for one in message.signals if one.length == 1 and one.is_signed]
        for flag in flags:  # BUSMASTER's; as a number 1 on the wire would be -1
            flag.is_signed = False
        if flags:
            message.refresh(strict=False)
    return database


def cycle_ms_of(message: "Message") -> float | None:
    """Return a message's cycle time; None for one that is sent on events [ms].

    A default of the database holds for what is sent in cycles alone. Databases store it as a
    number, a text, or the place in a list of texts; raises SettingsError for what is no number.
    """
    own = message.dbc and message.dbc.attributes.get("GenMsgCycleTime")
    is_cyclic = own or not message.dbc or "cyclic" in str(message.send_type or "cyclic").lower()
    told: Any = message.cycle_time
    if not is_cyclic or not told:
        return None
    try:
        if own and own.definition.choices and isinstance(told, int):
            told = own.definition.choices[told]
        cycle_ms = float(str(told).removesuffix("ms"))
    except (ValueError, LookupError):
        cycle_ms = math.nan
    if cycle_ms <= 0.0:  # of messages that are sent on events
        return None
    if not math.isfinite(cycle_ms):
        raise SettingsError(f"{message.name} has a cycle time of {told!r}, no number")
    return cycle_ms


def _listed(message: "Message") -> ListedMessage:
    flags = EXTENDED if message.is_extended_frame else 0
    length = message.length
    is_j1939 = message.protocol == "j1939"
    if message.is_fd or (length > CLASSIC_LENGTH_MAX and not is_j1939):
        flags |= FD | BITRATE_SWITCH
        fits = padded_length(length)
        if fits is None:
            raise SettingsError(f"{message.name} has {message.length} bytes; a frame has 64")
        length = fits
    senders, cycle_ms = tuple(message.senders), cycle_ms_of(message)
    if cycle_ms is not None and not CYCLE_MS_MIN <= cycle_ms <= CYCLE_MS_MAX:
        allowed = f"allowed is {CYCLE_MS_MIN:g} to {CYCLE_MS_MAX:g} ms"
        raise SettingsError(f"{message.name} has a cycle time of {cycle_ms:g}; {allowed}")
    return ListedMessage(message.name, message.frame_id, flags, length, cycle_ms, senders)
