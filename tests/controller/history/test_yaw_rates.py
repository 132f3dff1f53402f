"""Yaw rates, stored at the samples at which they were taken."""

import random

import pytest

from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.history.history import BusHistory
from tests.support.nodes.fed_history import LIMITS, MS, PERIOD_NS, error

EVERY = 2
PARAMS = LoopDelayParams(PERIOD_NS, PERIOD_NS, 50.0, yaw_rate_samples=EVERY)


def late_by_s(deviation_s: float, first_counter: int, every: int = EVERY) -> BusHistory:
    """Return the history after frames that are late by a drawn time; a newer one wins."""
    rng, history = random.Random(1), BusHistory(PARAMS, LIMITS)
    frames = []
    for sample in range(3000):
        for is_state in (False, True)[: 1 + (sample % every == 0)]:
            late_ns = round(40 * MS + 1e9 * rng.gammavariate(4.0, 0.5) * deviation_s)
            frames.append((sample * PERIOD_NS + late_ns, is_state, sample))
    newest = [-1, -1]
    for arrival_ns, is_state, sample in sorted(frames):
        if sample < newest[is_state]:
            continue
        newest[is_state] = sample
        if is_state:
            counter = (sample // every + first_counter) % 256
            history.on_vehicle(1e-4 * sample, counter, arrival_ns)
        else:
            history.on_error(error(0.0), sample % 256, arrival_ns)
    return history


@pytest.mark.parametrize("deviation_s", [0.0, 0.01, 0.02])
@pytest.mark.parametrize(("first_counter", "every"), [(0, 2), (77, 2), (0, 1), (5, 3)])
def test_yaw_rates_are_of_the_sample_that_took_them(
    deviation_s: float, first_counter: int, every: int
) -> None:
    """Whenever they come; if a sender counts in its own way, within what jitter leaves unknown."""
    rings = late_by_s(deviation_s, first_counter, every).history
    stored = [sample for sample in range(1000, 3000) if rings.yaw_rate_sample[sample] == sample]
    assert len(stored) > (1990 if deviation_s == 0.0 else 1000) / every
    apart = [abs(rings.yaw_rate_rad_s[sample] - 1e-4 * sample) for sample in stored]
    is_exact = (first_counter, every) == (0, EVERY) or deviation_s == 0.0
    assert max(apart) < (1e-9 if is_exact else 3.1e-4)


@pytest.mark.parametrize("seed", range(8))
def test_a_plant_that_starts_again_counts_from_its_start(seed: int) -> None:
    """Of either, the sample is that of the error that was measured with it."""
    rng, history = random.Random(seed), BusHistory(PARAMS, LIMITS)
    stop, pause = rng.randrange(100, 900), rng.randrange(30, 400)
    rings = history.history
    for number in (*range(stop), *range(stop + pause, stop + pause + 300)):
        own, now_ns = number - (stop + pause) * (number >= stop), number * PERIOD_NS
        history.on_error(error(1e-4 * number), own % 256, now_ns)
        if own % EVERY == 0:
            history.on_vehicle(1e-4 * number, own // EVERY % 256, now_ns)
            at = history._errors.sample % len(rings.yaw_rate_sample)
            assert rings.yaw_rate_sample[at] == history._errors.sample
            assert rings.yaw_rate_rad_s[at] == rings.lateral_error_m[at]


def test_the_filter_waits_for_a_yaw_rate_but_not_for_a_lost_one() -> None:
    history = BusHistory(PARAMS, LIMITS)
    history.on_error(error(0.0), 0, 0)
    history.on_vehicle(0.0, 0, 0)
    settled = []
    for sample in range(1, 40):
        now_ns = sample * PERIOD_NS
        history.on_error(error(0.0), sample, now_ns)
        history._echoes = history._echoes._replace(sample=sample, arrival_ns=now_ns)
        settled.append(history.loop_delay(sample, now_ns).settled_sample)
    assert settled == [max(1, sample - 16) for sample in range(1, 40)]
