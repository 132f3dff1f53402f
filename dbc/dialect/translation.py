"""Frames of a car as ours: commands for the plant, measurements for the controller."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from .. import messages as ours
from .car_message import CarMessage, Refused
from .dialect import Dialect
from .quantities import SAID_BY, Values
from .settings import Quantity


class Translation:
    """Messages of the car as ours.

    A car echoes no counter of a command: that of the last one sent stands for it, so that the delay
    which the controller measures is that of the measurements alone. A quantity that the car lacks
    is 0; one that only says that the car is engaged, or follows commands, is 1.
    """

    def __init__(self, dialect: Dialect) -> None:
        is_engaged = float(Quantity.ENGAGED not in dialect.carried)
        self._known = {**dict.fromkeys(Quantity, 0.0), Quantity.APPLYING: 1.0}
        self._known[Quantity.ENGAGED] = is_engaged
        self._senders: Mapping[type[ours.Message], ours.Sender] = {
            kind: ours.Sender(kind) for kind in SAID_BY
        }
        self._sent_counter = self._number = 0
        self._last: tuple[int, float] | None = None

    def note_sent(self, message: ours.Message) -> None:
        """Keep the counter of the last command."""
        if isinstance(message, ours.SteeringCommand):
            self._sent_counter = message.command_counter

    def frames(self, message: CarMessage, values: Values, now_ns: int) -> Sequence[Frame] | Refused:
        """Return our messages whose first quantity has come, or why the car would refuse it."""
        if why := self._refusal(message, values, now_ns):
            return why
        self._known |= values
        fields: dict[str, Any] = {str(name): value for name, value in self._known.items()}
        fields |= {"applied_counter": self._sent_counter, "command_counter": self._number}
        fields |= {"status": _CODES[_is_one(self._known[Quantity.APPLYING])]}
        fields |= {"mode": ours.Mode.ACTIVE}
        if Quantity.STEER in values:
            self._last = now_ns, values[Quantity.STEER]
            self._number = (self._number + 1) % ours.COMMAND_COUNTERS
        return [
            sender.frame(kind._make(fields[name] for name in kind._fields))
            for kind, sender in self._senders.items()
            if next(iter(SAID_BY[kind])) in values
        ]

    def _refusal(self, message: CarMessage, values: Values, now_ns: int) -> Refused | None:
        if Quantity.ENGAGED in values:
            self._known[Quantity.ENGAGED] = values[Quantity.ENGAGED]
        steer_rad = values.get(Quantity.STEER)
        if steer_rad is not None and not _is_one(self._known[Quantity.ENGAGED]):
            return Refused.NOT_ENGAGED
        if not (math.isfinite(values.get(Quantity.APPLYING, 1.0)) and _is_carried(values)):
            return Refused.OUT_OF_RANGE
        if steer_rad is not None and self._is_too_fast(message, steer_rad, now_ns):
            return Refused.TOO_FAST
        return None

    def _is_too_fast(self, message: CarMessage, steer_rad: float, now_ns: int) -> bool:
        rate_rad_s = message.rate_max_rad_s
        if rate_rad_s is None or self._last is None:
            return False
        since_s = max((now_ns - self._last[0]) / NS_PER_S, 1e-3 * message.settings.cycle_ms)
        return abs(steer_rad - self._last[1]) > rate_rad_s * since_s


_CODES = (ours.SteeringStatusCode.NO_COMMAND, ours.SteeringStatusCode.APPLYING)


_LIMITS: Mapping[Quantity, ours.SignalRange] = {
    name: ours.limits(kind)[name]
    for kind, said in SAID_BY.items()
    for name in said
    if name in ours.limits(kind)
}


def _is_carried(values: Values) -> bool:
    """Whether messages of ours can carry the values; not a number is none."""
    return all(
        _LIMITS[name].minimum <= value <= _LIMITS[name].maximum
        for name, value in values.items()
        if name in _LIMITS
    )


def _is_one(value: float) -> bool:
    """Whether a value is nearest to 1; not a number is not."""
    return 0.5 < value < 1.5
