"""Delay that the controller learns from counters alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.history.echo_delay import (
    NO_DELAY,
    DelayState,
    LoopDelayParams,
    delay_of,
    delay_step,
    unwrapped,
)
from steer_by_wire.controller.history.history import RING_SIZE, BusHistory
from steer_by_wire.controller.law_interface import LoopDelay
from steer_by_wire.dbc.messages import SteeringStatusCode
from tests.support.nodes.fed_history import (
    LIMITS,
    MS,
    NO_COMMAND,
    PARAMS,
    PERIOD_NS,
    driven,
    echo,
    error,
)

APPLYING = int(SteeringStatusCode.APPLYING)

# The mean of the offsets


def delays(pairs: list[tuple[int, int]], params: LoopDelayParams = PARAMS) -> DelayState:
    x = NO_DELAY
    for sample, tick in pairs:
        x = delay_step(params, x, sample, tick, APPLYING)
    return x


def test_the_delay_of_a_constant_latency_is_reported_to_half_a_period() -> None:
    """A command of tick k in effect at sample k + 8 acts 70 to 80 ms after its tick."""
    x = delays([(tick + 8, tick) for tick in range(100)])
    assert delay_of(PARAMS, x, 107) == 75 * MS


def test_an_echo_without_a_command_or_after_a_gap_in_them_changes_nothing() -> None:
    x = delays([(8, 0), (9, 1)])
    assert delay_step(PARAMS, x, 10, 1, int(SteeringStatusCode.HOLDING)) == x
    assert delay_step(PARAMS, x, 10, -1, APPLYING) == x


def test_before_any_command_is_echoed_it_acts_after_the_newest_echo_at_the_earliest() -> None:
    assert delay_of(PARAMS, NO_DELAY, 6) == 7 * PERIOD_NS


@pytest.mark.parametrize("jump", [-150, 150])
def test_an_offset_that_jumps_by_more_than_a_second_is_a_restart(jump: int) -> None:
    x = delays([(tick + 8, tick) for tick in range(100)])
    x = delay_step(PARAMS, x, 108 + jump, 100, APPLYING)
    assert x == DelayState(1, float((8 + jump) * PERIOD_NS))


# Numbers from counters


@given(st.integers(-2_000, 2_000), st.integers(-128, 127))
def test_a_counter_of_8_bits_is_unwrapped_within_half_a_round(number: int, off: int) -> None:
    assert unwrapped(number % 256, number - off) == number


# The history


def test_samples_and_ticks_are_numbered_through_many_rounds_of_the_counters() -> None:
    fed = driven(3000, latency=7)
    loop_delay = fed.loop_delay(3000)
    assert loop_delay == LoopDelay(3000, 2999, 2999, 65.0 * MS, True, -1, 2999)
    history = fed.history.history
    for sample in (2000, 2600, 2999):
        assert history.lateral_error_m[sample & history.sample_mask] == 0.001 * sample
        assert history.heading_error_rad[sample & history.sample_mask] == 0.0001 * sample
        assert history.applied_tick[sample & history.sample_mask] == sample - 7
        assert history.sent_rad[sample & history.tick_mask] == 0.01 * sample


def test_nothing_is_known_before_the_speed_is() -> None:
    history = BusHistory(PARAMS, LIMITS)
    history.on_error(error(0.1), 0, 0)
    history.on_echo(echo(0, NO_COMMAND), 0, 0)
    assert history.loop_delay(0, 0) == LoopDelay(0, -1, -1, 0.0, False)
    history.on_vehicle(0.0, 0, 0)
    assert history.loop_delay(0, 0).error_sample == 0


def test_a_lost_measurement_leaves_a_gap_and_its_echo_stays() -> None:
    fed = driven(50, latency=3)
    fed.history.on_echo(echo(47), 50, 50 * PERIOD_NS)
    fed.sample(51, 48)
    history = fed.history.history
    assert not history.has_error[50]
    assert history.has_error[49]
    assert history.has_error[51]
    assert history.applied_tick[50] == 47


def test_a_lost_echo_takes_the_command_before_to_have_stayed() -> None:
    fed = driven(50, latency=3)
    for number in (50, 51):
        fed.history.on_error(error(0.0), number, number * PERIOD_NS)
    assert fed.loop_delay(52).echo_sample == 49
    assert fed.loop_delay(52).error_sample == 51
    fed.sample(52, 49)
    assert [fed.history.history.applied_tick[number] for number in (49, 50, 51, 52)] == [
        46,
        46,
        46,
        49,
    ]


def test_a_gap_longer_than_the_counters_round_is_bridged_by_the_clock() -> None:
    fed = driven(50, latency=3)
    for number in range(50, 650):
        fed.command(number, 0.5)
    fed.sample(650, 647)
    assert fed.loop_delay(650).error_sample == 650
    history = fed.history.history
    assert not any(history.has_error[number] for number in range(50, 650))


def test_an_echo_is_of_the_tick_that_sent_it_though_ticks_were_skipped() -> None:
    fed = driven(20, latency=3)
    for period in (25, 26):
        fed.command(period, 0.7)
    fed.sample(30, 20)  # the command after the twenty before
    assert fed.history.history.applied_tick[30] == 25


def test_echoes_that_stop_make_the_delay_unknown_after_the_timeout() -> None:
    fed = driven(50, latency=3)
    last_ns = 49 * PERIOD_NS
    timeout_ns = LIMITS.steering_status_ns
    fed.history.on_vehicle(0.0, 0, last_ns + timeout_ns)
    assert fed.history.loop_delay(79, last_ns + timeout_ns).is_measured
    assert not fed.history.loop_delay(80, last_ns + timeout_ns + 1).is_measured


def test_a_speed_that_is_too_old_makes_the_delay_unknown_but_what_is_known_of_it_stays() -> None:
    fed = driven(50, latency=3)
    until_ns = 49 * PERIOD_NS + LIMITS.vehicle_state_ns
    fresh, stale = fed.history.loop_delay(64, until_ns), fed.history.loop_delay(64, until_ns + 1)
    assert fresh.is_measured
    assert stale == fresh._replace(is_measured=False)
    fed.history.on_vehicle(0.0, 0, until_ns + 1)
    assert fed.history.loop_delay(64, until_ns + 1) == fresh


def test_a_plant_that_starts_anew_is_known_again_with_its_first_echo() -> None:
    """Its counters begin again; the clock and the command counter say where they belong."""
    fed = driven(50, latency=3)
    now = 700
    for number in range(50, now):
        fed.command(number, 0.5)
    for number in range(100):  # the plant's samples 0, 1, ... with echoes of the present
        fed.history.on_echo(echo(now + number - 3), number % 256, (now + number) * PERIOD_NS)
        fed.command(now + number, 0.5)
    loop_delay = fed.history.loop_delay(now + 100, (now + 100) * PERIOD_NS)
    history = fed.history.history
    assert history.applied_tick[loop_delay.echo_sample & history.sample_mask] == now + 96
    # From a sample to where a command acts: that is all a prediction needs.
    acts_ns = loop_delay.tick * PERIOD_NS + loop_delay.delay_ns - loop_delay.echo_sample * PERIOD_NS
    assert acts_ns == pytest.approx(3.5 * PERIOD_NS, abs=0.01 * PERIOD_NS)


def test_an_echo_of_a_command_forgotten_or_never_sent_is_none() -> None:
    fed = driven(50, latency=3)
    fed.sample(50, 60)  # never sent
    assert fed.history.history.applied_tick[50] == -1
    for number in range(50, 50 + RING_SIZE):
        fed.command(number, 0.0)
    number = 50 + RING_SIZE
    fed.sample(number, 40)
    assert fed.history.history.applied_tick[number & fed.history.history.sample_mask] == -1
