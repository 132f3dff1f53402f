"""A counter rule by its largest step, at the shortest period and without time to pass."""

from steer_by_wire.dbc.codec.counter_rule import PERIOD_NS_MIN, CounterRule


def rule(step_max: int = 10, resync_run: int = 3, resync_ns: int = 0) -> CounterRule:
    return CounterRule((step_max - 1) * PERIOD_NS_MIN, resync_run, resync_ns)
