"""Which counters a tested receiver believes, at the shortest period and without time to pass."""

from steer_by_wire.dbc.codec.sequence_and_second_sender import (
    PERIOD_NS_MIN,
    SequenceCheck,
    SequenceRule,
)


def rule(step_max: int = 10, resync_run: int = 3, resync_ns: int = 0) -> SequenceRule:
    return SequenceRule((step_max - 1) * PERIOD_NS_MIN, resync_run, resync_ns)


def checking(step_max: int = 10, resync_run: int = 3, resync_ns: int = 0) -> SequenceCheck:
    return SequenceCheck(rule(step_max, resync_run, resync_ns), PERIOD_NS_MIN)
