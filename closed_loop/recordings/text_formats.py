"""Readers of .asc, .csv and .trc, line by line, so that a line costs no other.

Each takes a line and returns its frame, or None where the format has no frame there: a comment, the
header, an event that is none of CAN's. Every other line raises ValueError, LookupError or
OverflowError.
"""

import re
from base64 import b64decode
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta

from can.util import dlc2len

from ...runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_MS, NS_PER_S, NS_PER_US
from .logged import LogError, Logged, NoFrameError, logged

_HEXADECIMAL = re.compile(r"[0-9A-Fa-f]+", re.ASCII)


def _number(word: str, base: int = 16) -> int:
    if not _HEXADECIMAL.fullmatch(word):  # int() takes signs and underscores too
        raise ValueError
    return int(word, base)


def _frame(can_id: int, flags: int, words: Sequence[str], length: int, base: int = 16) -> Frame:
    """Return a frame with the payload in words, none if it is remote."""
    if flags & REMOTE:
        return Frame(can_id, b"", flags)
    if len(words) != length or (base == 16 and any(len(word) != 2 for word in words)):
        raise ValueError
    return Frame(can_id, bytes(_number(word, base) for word in words), flags)


def _time_ns(word: str, unit_ns: int) -> int:
    return round(float(word) * unit_ns)


_ASC_HEADER = {"base", "date", "no", "internal", "begin", "end"}
_OTHER_BUSES = ("a429", "afdx", "eth", "j1708", "j1939", "l", "most", "mst", "wlan")
"""Beginnings of events that name a bus, or a protocol above CAN, and a direction."""
_FLEXRAY = "fr"


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
        if first.startswith("//") or first in _ASC_HEADER:
            return None
        time_ns = _time_ns(first, NS_PER_S)
        if self._is_relative:  # to the line before
            self._now_ns = time_ns = self._now_ns + time_ns
        event = words[1]
        if event.isdecimal():
            frame = self._classic(words[2:])
        elif event == "CANFD":
            event, frame = words[2], self._fd(words[3:])
        elif event[0].isalpha() and len(words) > 2 and not _of_can(event, words[2:]):
            return None
        else:
            raise ValueError
        # The channels of python-can count from 0, those of the format from 1.
        return frame and logged(time_ns, str(int(event) - 1), frame)

    def _classic(self, words: Sequence[str]) -> Frame | None:
        """Read identifier, direction, kind, length and payload."""
        if words[0].casefold() == "errorframe":
            return Frame(0, b"", ERROR)
        if words[0].startswith(("Statistic:", "OverloadFrame", "J1939TP")):
            return None
        identifier, direction, kind, *rest = words
        flags = {"d": 0, "r": REMOTE}[kind.casefold()]
        length = 0 if flags else min(_number(rest[0], self._base), 8)
        return self._sent(direction, identifier, flags, rest[1 : 1 + length], length)

    def _fd(self, words: Sequence[str]) -> Frame | None:
        """Read direction, identifier, a name, two bits, length twice, payload, and its flags."""
        direction, identifier, *rest = words
        if identifier.casefold() == "errorframe":
            return Frame(0, b"", ERROR) if _was_on_bus(direction) else None
        if rest[0] not in {"0", "1"}:
            del rest[0]
        switch, _, code, size, *data = rest
        length = _number(size, 10)
        kind = _number(data[length + 2]) if len(data) > length + 2 else 0x1000
        flags = FD if kind & 0x1000 or length > 8 else 0
        flags |= BITRATE_SWITCH if switch == "1" else 0
        flags |= REMOTE if not length and (kind & 0x10 or code != "0") else 0
        return self._sent(direction, identifier, flags, data[:length], length)

    def _sent(
        self, direction: str, identifier: str, flags: int, words: Sequence[str], length: int
    ) -> Frame | None:
        """Return a frame that was on the bus; None for a request to send it."""
        word = identifier.rstrip("xX")
        is_number = word.isdecimal() if self._base == 10 else _HEXADECIMAL.fullmatch(word)
        if identifier.isidentifier() and not is_number:
            raise NoFrameError("a name in place of the identifier: export it as number")
        flags |= EXTENDED if word != identifier else 0
        frame = _frame(_number(word, self._base), flags, words, length, self._base)
        return frame if _was_on_bus(direction) else None


def _of_can(event: str, words: Sequence[str]) -> bool:
    """Whether an event, which is none of CAN's in its name, has a frame of CAN behind it."""
    event = event.casefold()
    is_frame = event.startswith("canfd") or any(
        word.casefold() in {"rx", "tx", "txrq"} for word in words
    )
    return is_frame and event != _FLEXRAY and not event.startswith(_OTHER_BUSES)


def _was_on_bus(direction: str) -> bool:
    """Whether a frame was received or sent; False for a request to send it."""
    return {"rx": True, "tx": True, "txrq": False}[direction.casefold()]


_TRC_STATUS = {"Warng", "ST", "EC", "EV"}


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
    _FLAGS: Mapping[str, int] = {
        **dict.fromkeys(("Rx", "Tx", "DT"), 0),
        **dict.fromkeys(("FD", "BI"), FD),
        **dict.fromkeys(("FB", "FE"), FD | BITRATE_SWITCH),
        "RR": REMOTE,
    }

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
        if kind in _TRC_STATUS or row.get("I") == "FFFFFFFF":  # of the bus
            return None
        if kind in {"Error", "ER"}:
            return logged(time_ns, row.get("B", "1"), Frame(0, b"", ERROR))
        flags, data = self._FLAGS[kind], row.get("D", "")
        flags |= EXTENDED if len(row["I"]) > 4 else 0
        flags |= REMOTE if data == "RTR" else 0
        length = _number(row["l"] if "l" in row else row["L"], 10)
        if "T" in self._columns and "L" in row and flags & FD:
            length = dlc2len(length)
        frame = _frame(_number(row["I"]), flags, data.split(), length)
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


_PYTHON_CAN = ("timestamp", "arbitration_id", "extended", "remote", "error", "dlc", "data")
_SAVVYCAN = ("time stamp", "id", "extended", "bus", "len", "d1")
_YES = {"1": True, "true": True, "0": False, "false": False}


class CsvReader:
    """Reads lines of a .csv of python-can or SavvyCAN, by the names in its first line."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._separator = ","

    def __call__(self, line: str) -> Logged | None:
        """Read a line."""
        if not line.strip():
            return None
        if not self._names and "," not in line and ";" in line:  # of a spreadsheet's language
            self._separator = ";"
        words = [word.strip().strip('"') for word in line.split(self._separator)]
        if not self._names:
            self._names = [name.casefold() for name in words]
            if not any({*names} <= {*self._names} for names in (_PYTHON_CAN, _SAVVYCAN)):
                python_can, savvycan = ",".join(_PYTHON_CAN), ",".join(_SAVVYCAN)
                raise LogError(
                    f"the columns of a .csv are {python_can} (python-can) or {savvycan} (SavvyCAN)"
                )
            return None
        row = dict(zip(self._names, words, strict=False))
        flags = EXTENDED if _YES[row["extended"].casefold()] else 0
        if "d1" in row:
            length, first = int(row["len"]), self._names.index("d1")
            flags |= FD if length > 8 else 0
            frame = _frame(_number(row["id"]), flags, words[first : first + length], length)
            return logged(_time_ns(row["time stamp"], NS_PER_US), row["bus"], frame)
        data = b64decode(row["data"], validate=True)
        flags |= REMOTE if _YES[row["remote"]] else 0
        flags |= ERROR if _YES[row["error"]] else 0
        flags |= FD if len(data) > 8 else 0
        if not flags & REMOTE and len(data) != int(row["dlc"]):
            raise ValueError
        frame = Frame(_number(row["arbitration_id"].removeprefix("0x")), data, flags)
        return logged(_time_ns(row["timestamp"], NS_PER_S), "", frame)


READERS: Mapping[str, Callable[[], Callable[[str], Logged | None]]] = {
    ".asc": AscReader,
    ".csv": CsvReader,
    ".trc": TrcReader,
}
"""By the suffix of a log."""
