"""When a faulty measurement was on the bus, and when the controller reacted to it."""

from collections.abc import Iterable
from typing import NamedTuple

from ...dbc.codec.protection import COUNTERS
from ...dbc.contract.enumerations import Mode
from ...dbc.messages import Decoded, LateralError, Rejection, SteeringCommand, SteeringPlan

_LATE = 1.8
"""Periods after which a measurement counts as late: more than the jitter of a bus explains."""
_SILENT_PERIODS = 5
"""Periods without a command, at the end of the log, after which the silence is a reaction."""


class Detection(NamedTuple):
    """Both times in the log [ns]; None for what did not happen."""

    onset_ns: int | None
    reaction_ns: int | None


def first_reaction(
    received: Iterable[tuple[int, Decoded | Rejection]], period_ns: int
) -> Detection:
    """Return the first faulty measurement and the first command after it that reacts.

    The end of the commands is a reaction too.

    ``received``   LATERAL_ERROR, commands and plans, and what cannot be read, each with its time
    ``period_ns``  of the measurements [ns]
    """
    onset_ns = reaction_ns = None
    measured_ns = command_ns = None
    counter = -1
    time_ns = 0
    for time_ns, one in received:
        message = None if isinstance(one, Rejection) else one.message
        is_late = measured_ns is not None and time_ns - measured_ns > _LATE * period_ns
        if onset_ns is None and is_late and measured_ns is not None:
            onset_ns = measured_ns + period_ns
        if isinstance(message, SteeringCommand | SteeringPlan):
            command_ns = time_ns
            if onset_ns is not None and message.mode != Mode.ACTIVE:
                return Detection(onset_ns, time_ns)
            continue
        if onset_ns is not None:
            continue
        if not isinstance(message, LateralError) or isinstance(one, Rejection):
            onset_ns = time_ns
        else:
            expected = (counter + 1) % COUNTERS
            if counter >= 0 and one.counter != expected:
                onset_ns = time_ns
            counter, measured_ns = one.counter, time_ns
    silence_ns = _SILENT_PERIODS * period_ns
    if onset_ns is not None and command_ns is not None and time_ns - command_ns > silence_ns:
        reaction_ns = command_ns + period_ns
    return Detection(onset_ns, reaction_ns)
