"""The delay from command to measurement, by echo, in DELAY_STATUS and in the report."""

import pytest

from steer_by_wire import simulate
from steer_by_wire.controller.node.reported_delay import (
    NO_ECHO,
    EchoRule,
    delay_status,
    echo_delay_s,
    echo_step,
)
from steer_by_wire.dbc.messages import DelayStatus, EchoState, limits
from steer_by_wire.runtime.node import NS_PER_S
from tests.support.frames.made_messages import message_with

PERIOD_NS = 10_000_000
RULE = EchoRule(PERIOD_NS / 2, 500e6, 300_000_000)


def test_the_echo_measures_down_and_up_less_half_a_period() -> None:
    echo = NO_ECHO
    assert echo_delay_s(RULE, echo, 0) is None
    for counter in range(100):
        now_ns = counter * PERIOD_NS
        # Sent 5 ms after the tick, echoed 12 periods after it and 3 ms.
        sent_ns = now_ns - 12 * PERIOD_NS + 5_000_000
        echo = echo_step(RULE, echo, sent_ns, now_ns + 3_000_000)
    end_ns = 100 * PERIOD_NS
    assert echo_delay_s(RULE, echo, end_ns) == pytest.approx(0.118 - 0.005)
    assert echo_delay_s(RULE, echo, end_ns + NS_PER_S) is None


def test_a_delay_is_sent_within_the_range_of_its_signal() -> None:
    largest_s = limits(DelayStatus)["echo_delay_s"].maximum
    assert delay_status(None) == message_with(DelayStatus)
    assert delay_status(0.1) == message_with(
        DelayStatus, echo_delay_s=0.1, echo_state=EchoState.KNOWN
    )
    assert delay_status(10.0) == message_with(
        DelayStatus, echo_delay_s=largest_s, echo_state=EchoState.KNOWN
    )


def test_a_run_reports_the_networks_delay_within_half_a_period() -> None:
    network = {"plant.latency.uplink.mean_s": 0.06}
    run = simulate(seed=7, duration_s=5.0, latency_s=0.12, overrides=network)
    assert run.controller_report["delay"]["echo_s"] == pytest.approx(0.18, abs=0.0055)


@pytest.mark.parametrize(("delay_ms", "is_long"), [(250.0, False), (265.0, True)])
def test_the_declared_delay_itself_is_not_too_long(delay_ms: float, is_long: bool) -> None:
    run = simulate(controller="practical_pd_ddob", latency_s=1e-3 * delay_ms, duration_s=4.0)
    assert ("delay_long" in run.controller_report["validity_share"]) is is_long
