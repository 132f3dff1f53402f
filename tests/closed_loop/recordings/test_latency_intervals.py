"""Latencies of drawn networks: what a log says of them, with its interval, against the truth."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from steer_by_wire.closed_loop.recordings.durations import CONFIDENCE
from steer_by_wire.closed_loop.recordings.latency_and_jitter import Latencies
from steer_by_wire.closed_loop.recordings.sensing_times import relative_uplink
from steer_by_wire.dbc.messages import PlantStatus, SteeringStatus, SteeringStatusCode
from tests.support.frames.made_messages import command_of, message_with

NS = 1_000_000_000
COUNTERS = 256


class Network(NamedTuple):
    """A drawn network: its uplink, and the log of one run through it."""

    uplink: Any
    period_s: float
    latencies: Latencies
    downlink_s: list[float]


def drawn(seed: int, duration_s: float = 40.0) -> Network:
    """Return a network with sensors of 2 to 100 Hz; latencies follow an AR(1) process."""
    rng = np.random.default_rng([58, seed])
    period_s = float(rng.choice([0.01, 0.02, 0.025, 0.05, 0.1, 0.5]))
    mean_s, spread_s = rng.uniform(0.03, 0.12), rng.uniform(0.002, 0.02)
    shape = (mean_s / spread_s) ** 2
    uplink = [
        stats.gamma(shape, scale=mean_s / shape),
        stats.norm(mean_s + 5.0 * spread_s, spread_s),
        stats.uniform(mean_s, 4.0 * spread_s),
        stats.expon(mean_s, spread_s),
    ][rng.integers(4)]
    count = round(max(duration_s, 100 * period_s) / period_s)
    kept = np.exp(-period_s / rng.uniform(0.1, 1.0)) if rng.random() < 0.3 else 0.0
    z = rng.standard_normal(count)
    for k in range(1, count):
        z[k] = kept * z[k - 1] + np.sqrt(1.0 - kept**2) * z[k]
    sensed_s = period_s * np.arange(1, count + 1)
    latency_s = uplink.ppf(stats.norm.cdf(z))
    is_lost = rng.random(count) < rng.uniform(0.0, 0.05)
    sent_s = 0.0037 + 0.01 * np.arange(round(sensed_s[-1] / 0.01))
    came_s = sent_s + rng.gamma(16.0, 0.003, len(sent_s))
    events: list[tuple[float, int, Any]] = [
        *((at, 0, counter) for counter, at in enumerate(sent_s.tolist())),
        *((sensed_s[k] + latency_s[k], 1, k) for k in range(count) if not is_lost[k]),
        *((float(at), 2, None) for at in np.arange(0.1, sensed_s[-1] + mean_s, 0.1)),
    ]
    latencies, newest, named, downlink_s = Latencies(), -1, set[int](), list[float]()
    in_effect = np.full(count, -1)
    order, last = np.argsort(came_s), -1
    arrived = 0
    for k in range(count):
        while arrived < len(order) and came_s[order[arrived]] <= sensed_s[k]:
            last = max(last, int(order[arrived]))  # the newest wins
            arrived += 1
        in_effect[k] = last
    for at_s, kind, k in sorted(events, key=lambda event: event[:2]):
        at_ns = round(at_s * NS)
        if kind == 0:
            latencies.on_command(command_of(command_counter=k % COUNTERS), at_ns)
            continue
        if kind == 2:
            reported_s = 0.0005 * round(float(uplink.rvs(random_state=rng)) / 0.0005)
            report = message_with(PlantStatus, uplink_latency_s=reported_s)
            latencies.on_plant_frame(at_ns)
            latencies.on_plant_status(report, at_ns)
            continue
        is_late, command = k < newest, int(in_effect[k])
        newest = max(newest, k)
        applied = {"applied_counter": max(command, 0) % COUNTERS}
        if command >= 0:
            applied["status"] = SteeringStatusCode.APPLYING
        status = message_with(SteeringStatus, **applied)
        latencies.on_plant_frame(at_ns)
        latencies.on_status(status, k % COUNTERS, is_late, at_ns)
        if command >= 0 and not is_late and command not in named:
            named.add(command)
            downlink_s.append(float(sensed_s[k] - sent_s[command]))
    latencies.close_block()
    return Network(uplink, period_s, latencies, downlink_s)


def held(seeds: range) -> dict[str, list[bool]]:
    """Return for each figure in which networks its interval holds the true value."""
    found: dict[str, list[bool]] = {}
    for seed in seeds:
        network = drawn(seed)
        report = network.latencies.measured["uplink"].report()
        truth = {
            "mean_s": network.uplink.mean(),
            "p50_s": network.uplink.median(),
            "p99_s": network.uplink.ppf(0.99),
            "jitter_s": network.uplink.std(),
        }
        for name, true_s in truth.items():
            low_s, high_s = report["interval"][name]
            is_held = low_s <= true_s and (high_s is None or true_s <= high_s)
            found.setdefault(name, []).append(is_held)
    return found


def test_intervals_hold_the_network_as_often_as_they_say() -> None:
    networks = 20
    for name, is_held in held(range(networks)).items():
        # Fewer would come once in a thousand, were each held in 95 of 100.
        assert sum(is_held) >= stats.binom.ppf(0.001, networks, CONFIDENCE), name


@pytest.mark.parametrize("seed", range(100, 108))
def test_the_period_and_the_downlink_of_a_drawn_network_are_found(seed: int) -> None:
    network = drawn(seed)
    found = network.latencies
    assert found.sensor_period_s is not None
    error_s = found.sensor_period_error_s
    assert abs(found.sensor_period_s - network.period_s) <= max(4.0 * error_s, 1e-9)
    true_s = np.array(network.downlink_s)
    downlink = found.measured["downlink"].report()
    assert downlink["samples"] == len(true_s)
    assert downlink["mean_s"] == pytest.approx(
        true_s.mean(), abs=2.0 * found.measured["downlink"].level_error_s + 5e-4
    )
    assert downlink["jitter_s"] == pytest.approx(true_s.std(), abs=5e-4)


@given(
    st.lists(
        st.tuples(st.integers(-3, 300), st.just(0) | st.integers(-(10**10), 10**12)), min_size=2
    )
)
def test_whatever_the_clock_did_the_latencies_are_finite(steps: list[tuple[int, int]]) -> None:
    numbers, arrivals_ns = np.cumsum(np.array(steps), axis=0).T
    silences_ns = np.abs(np.diff(arrivals_ns, prepend=arrivals_ns[0]))
    with np.errstate(all="raise"):
        found = relative_uplink(numbers, arrivals_ns, silences_ns)
    assert np.isfinite(found.latency_ns).all()
    assert found.period_ns > 0.0
