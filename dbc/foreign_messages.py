"""Messages of any database that cantools reads, as traffic: identifier, length, cycle time, sender.

The databases of other people's vehicles: their signals are not decoded here.
"""

import logging
from pathlib import Path
from typing import NamedTuple

import cantools.database
from cantools.database.can import Database, Message

from ..runtime.exit_status import one_line
from ..runtime.frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, EXTENDED, FD
from ..runtime.frame.length_with_stuff_bits import padded_length


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
    cycle_ms: int | None
    senders: tuple[str, ...]

    @property
    def fits_a_frame(self) -> bool:
        """Whether one frame holds it: not so for a long message of J1939."""
        return self.length <= CLASSIC_LENGTH_MAX or bool(self.flags & FD)


def read_message_set(path: Path) -> tuple[ListedMessage, ...]:
    """Read a database; raises OSError, and ValueError for what is not one or holds no frames."""
    if path.is_file() and not path.stat().st_size:
        raise ValueError(f"{path}: is empty")
    # It warns of identifiers that come twice, which callers refuse in a line of their own.
    logging.getLogger("cantools").addHandler(logging.NullHandler())
    try:
        database = cantools.database.load_file(path, strict=False)
    except OSError:
        raise
    except Exception as error:  # cantools raises more than its own exceptions for a damaged file
        raise ValueError(f"{path}: {one_line(error)}") from error
    if not isinstance(database, Database):
        raise ValueError(f"{path}: not a database of CAN messages")
    return tuple(_listed(message, path) for message in database.messages)


def _listed(message: Message, path: Path) -> ListedMessage:
    flags = EXTENDED if message.is_extended_frame else 0
    length = message.length
    is_j1939 = message.protocol == "j1939"
    if message.is_fd or (length > CLASSIC_LENGTH_MAX and not is_j1939):
        flags |= FD | BITRATE_SWITCH
        fits = padded_length(length)
        if fits is None:
            raise ValueError(f"{path}: {message.name} has {message.length} bytes; a frame has 64")
        length = fits
    cycle_ms, senders = max(message.cycle_time or 0, 0) or None, tuple(message.senders)
    return ListedMessage(message.name, message.frame_id, flags, length, cycle_ms, senders)
