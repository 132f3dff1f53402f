"""Readers of .asc, .csv, .trc and BUSMASTER's logs, line by line, so that a line costs no other.

Each takes a line and returns its frame, or None where the format has no frame there: a comment, the
header, an event that is none of CAN's. Every other line raises ValueError or LookupError.
"""

import re
from base64 import b64decode
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

from can.util import dlc2len

from ...runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_MS, NS_PER_S, NS_PER_US
from .log_state import LogError, Logged, NoFrameError, logged

_OTHER_BUSES = ("a429", "afdx", "eth", "j1708", "j1939", "l", "most", "mst", "wlan")
"""Beginnings of events that name a bus, or a protocol above CAN, and a direction."""
_FLEXRAY = "fr"
_HEXADECIMAL = re.compile(r"[0-9A-Fa-f]+", re.ASCII)


def _number(word: str, base: int = 16) -> int:
    if not _HEXADECIMAL.fullmatch(word):  # int() takes signs and underscores too
        raise ValueError
    return int(word, base)


def _payload(words: Sequence[str], length: int, base: int = 16) -> bytes:
    if len(words) != length or (base == 16 and any(len(word) != 2 for word in words)):
        raise ValueError
    return bytes(_number(word, base) for word in words)


def _time_ns(word: str, unit_ns: int) -> int:
    try:
        return round(float(word) * unit_ns)
    except OverflowError as error:
        raise ValueError from error


class AscReader:
    """Reads lines of an .asc of Vector's tools, BUSMASTER or python-can."""

    def __init__(self) -> None:
        self._base, self._is_relative, self._now_ns = 16, False, 0

    def __call__(self, line: str) -> Logged | None:
        """Read a line."""
        words = line.split()
        first = words[0].casefold() if words else "//"
        if first == "base":
            self._base = 10 if "dec" in line.casefold() else 16
            self._is_relative = "relative" in line.casefold()
        if first.startswith("//") or first in {"base", "date", "no", "internal", "begin", "end"}:
            return None
        time_ns = _time_ns(first, NS_PER_S)
        if self._is_relative:  # to the line before
            self._now_ns = time_ns = self._now_ns + time_ns
        event = words[1]
        if event.isdecimal():
            frame = self._frame(words[2:])
        elif event == "CANFD":
            event, frame = words[2], self._fd_frame(words[3:])
        elif event[0].isalpha() and len(words) > 2 and not _of_can(event, words[2:]):
            return None
        else:
            raise ValueError
        # The channels of python-can count from 0, those of the format from 1.
        return frame and logged(time_ns, str(int(event) - 1), frame)

    def _frame(self, words: Sequence[str]) -> Frame | None:
        """Read identifier, direction, kind, length and payload."""
        if words[0].casefold() == "errorframe":
            return Frame(0, b"", ERROR)
        if words[0].startswith(("Statistic:", "OverloadFrame", "J1939TP")):
            return None
        identifier, direction, kind, *rest = words
        can_id, flags = self._identifier(identifier)
        if kind.casefold() == "r":
            return _sent(direction, Frame(can_id, b"", flags | REMOTE))
        if kind.casefold() != "d":
            raise ValueError
        length = min(_number(rest[0], self._base), 8)
        return _sent(direction, Frame(can_id, self._data(rest[1:], length), flags))

    def _fd_frame(self, words: Sequence[str]) -> Frame | None:
        """Read direction, identifier, a name, two bits, length twice, payload, and its flags."""
        direction, identifier, *rest = words
        if identifier.casefold() == "errorframe":
            return _sent(direction, Frame(0, b"", ERROR))
        if rest[0] not in {"0", "1"}:
            del rest[0]
        switch, _, code, size, *data = rest
        length = _number(size, 10)
        kind = _number(data[length + 2]) if len(data) > length + 2 else 0x1000
        can_id, flags = self._identifier(identifier)
        flags |= FD if kind & 0x1000 or length > 8 else 0
        flags |= BITRATE_SWITCH if switch == "1" else 0
        if not length and (kind & 0x10 or code != "0"):
            return _sent(direction, Frame(can_id, b"", flags | REMOTE))
        return _sent(direction, Frame(can_id, self._data(data, length), flags))

    def _data(self, words: Sequence[str], length: int) -> bytes:
        """Read the payload; what follows it is of no interest."""
        return _payload(words[:length], length, self._base)

    def _identifier(self, word: str) -> tuple[int, int]:
        try:
            return _number(word.rstrip("xX"), self._base), EXTENDED if word[-1] in "xX" else 0
        except ValueError as error:
            if re.fullmatch(r"[^\W\d]\w*", word):
                raise NoFrameError(
                    "a name in place of the identifier: export it as number"
                ) from error
            raise


def _of_can(event: str, words: Sequence[str]) -> bool:
    """Whether an event, which is none of CAN's in its name, has a frame of CAN behind it."""
    is_frame = any(word.casefold() in {"rx", "tx", "txrq"} for word in words)
    event = event.casefold()
    return is_frame and event != _FLEXRAY and not event.startswith(_OTHER_BUSES)


def _sent(direction: str, frame: Frame) -> Frame | None:
    """Return a frame that was on the bus; None for a request to send it."""
    if direction.casefold() == "txrq":
        return None
    if direction.casefold() not in {"rx", "tx"}:
        raise ValueError
    return frame


class TrcReader:
    """Reads lines of a .trc of PEAK's tools or python-can, of any version from 1.0 to 2.1."""

    _COLUMNS: Mapping[str, str] = {
        "1.0": "N,O,I,L,D",
        "1.1": "N,O,d,I,L,D",
        "1.2": "N,O,B,d,I,L,D",
        "1.3": "N,O,B,d,I,R,L,D",
        "2.0": "",
        "2.1": "",
    }
    """Number, offset, bus, direction or kind, identifier, reserved, length and data; of 2.0 and 2.1
    the file names them, and has the kind apart (T)."""

    def __init__(self) -> None:
        self._columns = self._COLUMNS["1.0"].split(",")
        self._start_ns = 0

    def __call__(self, line: str) -> Logged | None:
        """Read a line."""
        line = line.strip()
        if not line or line.startswith(";"):
            self._read_header(line)
            return None
        words = line.split(maxsplit=len(self._columns) - 1)
        row = dict(zip(self._columns, words, strict=False))
        if not row["N"].removesuffix(")").isdecimal():
            raise ValueError
        time_ns = self._start_ns + _time_ns(row["O"], NS_PER_MS)
        kind = row["T"] if "T" in self._columns else row.get("d", "Rx")
        if kind in {"Warng", "ST", "EC", "EV"} or row.get("I") == "FFFFFFFF":  # the bus's status
            return None
        if kind in {"Error", "ER"}:
            return logged(time_ns, row.get("B", "1"), Frame(0, b"", ERROR))
        if kind not in {"Rx", "Tx", "DT", "RR", "FD", "FB", "FE", "BI"}:
            raise ValueError
        flags = EXTENDED if len(row["I"]) > 4 else 0
        flags |= FD if kind in {"FD", "FB", "FE", "BI"} else 0
        flags |= BITRATE_SWITCH if kind in {"FB", "FE"} else 0
        data = row.get("D", "")
        length = _number(row["l"] if "l" in row else row["L"], 10)
        if "T" in self._columns and "L" in row and flags & FD:
            length = dlc2len(length)
        if kind == "RR" or data == "RTR":
            flags, data, length = flags | REMOTE, "", 0
        frame = Frame(_number(row["I"]), _payload(data.split(), length), flags)
        return logged(time_ns, row.get("B", "1"), frame)

    def _read_header(self, line: str) -> None:
        name, _, value = line.partition("=")
        value = value.strip()
        if name == ";$FILEVERSION":
            if value not in self._COLUMNS:
                known = ", ".join(self._COLUMNS)
                raise LogError(f"a .trc of version {value[:20]} is not read, only of {known}")
            self._columns = self._COLUMNS[value].split(",")
        elif name == ";$COLUMNS":
            self._columns = [column.strip() for column in value.split(",")]
        elif name == ";$STARTTIME":
            start = datetime(1899, 12, 30, tzinfo=UTC) + timedelta(days=float(value))
            self._start_ns = round(start.timestamp() * NS_PER_S)


class CsvReader:
    """Reads lines of a .csv of python-can or SavvyCAN, by the names in its first line."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._separator = ","

    def __call__(self, line: str) -> Logged | None:
        """Read a line."""
        if not self._names and "," not in line and ";" in line:  # of a spreadsheet's language
            self._separator = ";"
        words = [word.strip().strip('"') for word in line.split(self._separator)]
        if not self._names and line.strip():
            self._names = [name.casefold() for name in words]
            if not any({*names} <= {*self._names} for names in (_PYTHON_CAN, _SAVVYCAN)):
                python_can, savvycan = ",".join(_PYTHON_CAN), ",".join(_SAVVYCAN)
                raise LogError(
                    f"the columns of a .csv are {python_can} (python-can) or {savvycan} (SavvyCAN)"
                )
            return None
        if not line.strip():
            return None
        row = dict(zip(self._names, words, strict=False))
        return _of_savvycan(row, words) if "d1" in row else _of_python_can(row)


_PYTHON_CAN = ("timestamp", "arbitration_id", "extended", "remote", "error", "dlc", "data")
_SAVVYCAN = ("time stamp", "id", "extended", "bus", "len", "d1")
_YES = {"1": True, "true": True, "0": False, "false": False}


def _of_python_can(row: Mapping[str, str]) -> Logged:
    data = b64decode(row["data"], validate=True)
    flags = EXTENDED if _YES[row["extended"]] else 0
    flags |= REMOTE if _YES[row["remote"]] else 0
    flags |= ERROR if _YES[row["error"]] else 0
    flags |= FD if len(data) > 8 else 0
    if not flags & REMOTE and len(data) != int(row["dlc"]):
        raise ValueError
    frame = Frame(_number(row["arbitration_id"].removeprefix("0x")), data, flags)
    return logged(_time_ns(row["timestamp"], NS_PER_S), "", frame)


def _of_savvycan(row: Mapping[str, str], words: Sequence[str]) -> Logged:
    first, length = list(row).index("d1"), int(row["len"])
    flags = EXTENDED if _YES[row["extended"].casefold()] else 0
    flags |= FD if length > 8 else 0
    frame = Frame(_number(row["id"]), _payload(words[first : first + length], length), flags)
    return logged(_time_ns(row["time stamp"], NS_PER_US), row["bus"], frame)


BEGIN: Final = "***BUSMASTER"
_MODES = ("SYSTEM MODE", "ABSOLUTE MODE", "RELATIVE MODE")
"""Times of the day, since the start, and to the line before."""
_DAY_NS = 24 * 3600 * NS_PER_S
_BUSMASTER_LINE = re.compile(
    r"(\d+):(\d\d):(\d\d):(\d{4}) (?:Rx|Tx) (\w+) (0x[0-9A-F]+|\d+) ([sx]r?)(-?fd)? (\d+)"
    r"((?: [0-9A-F]+)*)\s*",
    re.ASCII | re.IGNORECASE,
)


class BusmasterReader:
    """Reads lines of a .log of BUSMASTER, which begins with ***BUSMASTER.

    ***HEX***                                                 or DEC, of identifiers and data
    ***SYSTEM MODE***                                         times of the day; see ``_MODES``
    10:41:26:3860 Rx 1 0x110 s 8 99 78 00 00 00 00 00 00      hours to 0.1 ms, channel, type, DLC
    """

    def __init__(self) -> None:
        self._base, self._is_relative, self._now_ns = 16, False, 0

    def __call__(self, line: str) -> Logged | None:
        """Return the frame of a line, None where it has none; raises ValueError."""
        if line.startswith("***"):
            words = line.strip("* \r\n").upper()
            self._base = {"HEX": 16, "DEC": 10}.get(words, self._base)
            if words in _MODES:
                self._is_relative = words == _MODES[-1]
            return None
        if not line.strip():
            return None
        match = _BUSMASTER_LINE.fullmatch(line.rstrip())
        if match is None:
            raise ValueError
        hours, minutes, seconds, parts = (int(word) for word in match.groups()[:4])
        time_ns = (3600 * hours + 60 * minutes + seconds) * NS_PER_S + parts * NS_PER_S // 10_000
        if self._is_relative:
            time_ns += self._now_ns
        elif time_ns < self._now_ns - _DAY_NS // 2:  # past midnight
            time_ns += _DAY_NS * (1 + (self._now_ns - time_ns - _DAY_NS // 2) // _DAY_NS)
        channel, can_id, kind, fd, length, payload = match.groups()[4:]
        if self._base == 16 and any(len(word) != 2 for word in payload.split()):
            raise ValueError
        data = bytes(int(word, self._base) for word in payload.split())
        flags = (EXTENDED if kind[0] in "xX" else 0) | (FD if fd else 0)
        if kind[1:]:
            flags, data = flags | REMOTE, b""
        elif len(data) != (dlc2len(int(length)) if fd and int(length) < 16 else int(length)):
            raise ValueError
        taken = logged(time_ns, channel, Frame(int(can_id, self._base), data, flags))
        self._now_ns = time_ns
        return taken


READERS: Mapping[str, Callable[[], Callable[[str], Logged | None]]] = {
    ".asc": AscReader,
    ".csv": CsvReader,
    ".trc": TrcReader,
}
"""By the suffix of a log."""
