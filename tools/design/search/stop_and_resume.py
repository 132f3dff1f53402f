"""How a search is stopped, by Ctrl-C or when its time is up, and how it goes on later.

A search is deterministic. The costs that it has computed are in a file beside its preset. If it is
stopped and begun again with the same files, it asks for the same costs in the same order, finds
most of them here, and ends where it would have ended. The file is of one law, specification,
vehicle and version; one of others is begun anew.
"""

import hashlib
import json
import math
import sys
import time
import zlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ....runtime.command_line import DISTRIBUTION, say
from ..specification import Specification
from ..vehicle_file import VehicleFile


class SearchStoppedError(Exception):
    """The user has stopped a search, or its time is up."""


class CtrlC:
    """A handler of signals that notes the first, and raises KeyboardInterrupt at the second."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.is_pressed = False

    def __call__(self, _number: int, _frame: Any) -> None:
        """Take a signal."""
        if self.is_pressed:
            raise KeyboardInterrupt
        self.is_pressed = True
        say(self._name, "ending with the best so far; Ctrl-C again ends at once", sys.stderr)


def stopped_after(
    minutes: float,
    progress: Callable[[float, float], None],
    clock_s: Callable[[], float] = time.monotonic,
) -> Callable[[float, float], None]:
    """Return a progress that ends its search when the time is up."""
    end_s = clock_s() + 60.0 * minutes

    def show(done: float, best: float) -> None:
        progress(done, best)
        if clock_s() > end_s:
            raise SearchStoppedError

    return show


class KeptCosts:
    """Costs by what was judged; ``file`` is None where none is to be kept."""

    def __init__(self, file: Path | None = None, digest: str = "") -> None:
        self._file = file
        self._known: dict[str, float] = {}
        if file is None:
            return
        try:
            found, *lines = file.read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            found, lines = "", []
        if found == digest:
            # The last line of a process that was killed may be cut off.
            self._known = dict(filter(None, map(_cost_of, lines)))
        else:
            file.write_text(f"{digest}\n", encoding="utf-8")

    def cost(self, what: Any, compute: Callable[[], float], ceiling: float = math.inf) -> float:
        """Return the cost of what has been judged before, or compute it.

        A cost above the ceiling need not be the true one, and is not kept.
        """
        key = hashlib.sha256(repr(what).encode()).hexdigest()[:24]
        if key in self._known:
            return self._known[key]
        value = compute()
        if value <= ceiling:
            self._known[key] = value
            if self._file is not None:
                with self._file.open("a", encoding="utf-8") as stream:
                    stream.write(_line_of(key, value))
        return value

    def forget(self) -> None:
        """Remove the file of a search that has ended."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)


def _line_of(key: str, cost: float) -> str:
    content = f"{key}\t{cost!r}"
    return f"{content}\t{zlib.crc32(content.encode()):08x}\n"


def _cost_of(line: str) -> tuple[str, float] | None:
    """Return key and cost of a line; None for a damaged one."""
    key, _, rest = line.partition("\t")
    try:
        cost = float(rest.partition("\t")[0])
    except ValueError:
        return None
    return (key, cost) if f"{line}\n" == _line_of(key, cost) else None


def kept_costs(file: Path, spec: Specification, vehicle: VehicleFile, *further: Any) -> KeptCosts:
    """Return the costs that an earlier search for the same has left in a file."""
    tables = [spec.model_dump(mode="json"), vehicle.model_dump(mode="json")]
    text = json.dumps([version(DISTRIBUTION), *tables, repr(further)])
    return KeptCosts(file, hashlib.sha256(text.encode()).hexdigest())
