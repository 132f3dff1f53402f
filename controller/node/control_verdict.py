"""The controller's verdict on its own work; how the path was held is the plant's to judge."""

from collections.abc import Mapping
from enum import StrEnum

from ...dbc.messages import Mode


class ControlVerdict(StrEnum):
    """How a run of the controller ended."""

    NO_START = "no start"  # no measurement ever arrived
    FAULT = "fault"  # it has found a fault in itself
    SAFE_STOP = "safe stop"  # measurements have stopped
    HOLDING = "holding"  # measurements have just stopped
    NO_EFFECT = "no effect"  # the law steers, but the plant no longer follows its commands
    IN_CONTROL = "in control"  # the run ends with the law steering


EFFECT_NS = 1_000_000_000
"""Without a new echo for longer, commands have no effect: however long the latency, the echo of an
older one comes with every measurement. A slow controller has EFFECT_PERIODS instead."""
EFFECT_PERIODS = 20
_OF_MODE: Mapping[Mode, ControlVerdict] = {
    Mode.WAITING: ControlVerdict.NO_START,
    Mode.ACTIVE: ControlVerdict.IN_CONTROL,
    Mode.HOLDING: ControlVerdict.HOLDING,
    Mode.SAFE_STOP: ControlVerdict.SAFE_STOP,
}
"""Verdict on a run that ends in a mode without a fault of its own."""


def control_verdict(
    failure: str, mode: Mode, in_effect: int, silent_ns: int, period_ns: int
) -> ControlVerdict:
    """Return the verdict on a run that ends in ``mode``.

    ``failure``    a fault that the controller has found in itself; empty without
    ``in_effect``  commands that were seen to take effect
    ``silent_ns``  time since the last of them [ns]
    ``period_ns``  of control [ns]
    """
    if failure:
        return ControlVerdict.FAULT
    verdict = _OF_MODE[mode]
    is_silent = silent_ns > max(EFFECT_NS, EFFECT_PERIODS * period_ns)
    if verdict is ControlVerdict.IN_CONTROL and (is_silent or not in_effect):
        return ControlVerdict.NO_EFFECT
    return verdict
