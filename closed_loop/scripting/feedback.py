"""Feedback loop of a plant's vehicle: wheel, bus, road, and the round trips at which it shakes.

Each cycle the wheel's angle is sampled and sent, the road wheel follows it, the road's torque is
sampled and sent back, and the motor holds it for a cycle. Between the samples everything is linear
and sampled exactly. The bus takes n whole cycles for both ways together; how they are shared
between the ways makes no difference.

    x[k+1] = F x[k] + g v[k]      w[k] = h x[k]      v[k] = w[k - n]

The number of unstable roots at n = 0 is counted by eigenvalues. With n a root crosses the unit
circle only at a frequency with |L| = 1, L(ω) = h (e^(jωT) I - F)⁻¹ g, and at n ω T = arg L(ω): it
leaves the circle where |L| falls with ω, and comes back where |L| rises. Counting these crossings
gives every range of unstable round trips, not only the first one.

Coulomb friction F damps a swing of amplitude A as b = 4 F/(π A ω) does, by its describing function
(A. Gelb and W. E. Vander Velde, Multiple-Input Describing Functions, McGraw-Hill 1968). So in a
loop that is unstable without it, swings grow from that A on whose b brings it to the margin.
"""

from collections.abc import Callable, Iterable, Iterator
from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ...controller.analysis import linear_system
from ...hand_wheel.analysis.nominal_road import Rack, road_torque, road_vehicle
from ...hand_wheel.analysis.sampled_laws import (
    PASS_THROUGH,
    SampledLaw,
    sampled_cdob,
    sampled_dob,
    zero_order_hold,
)
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.wheel import GRIPS, LinearSystem, Matrix, held_wheel, sensed_torque
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import ComplexArray

UP_TO_S = 2.0
"""The longest round trip that is looked at."""
_FREQUENCY_MIN_RAD_S = 1e-3
_FREQUENCIES = 4000
_BISECTIONS = 50
_DAMPINGS_N_M_S = 1e-3, 1e3
"""Which friction may stand for."""
_DAMPING_BISECTIONS = 14
"""To a thousandth of the damping."""


class UnstableRange(NamedTuple):
    """Round trips [s] at which the loop is unstable; ``end_s`` is None beyond the search.

    ``shakes_at_hz``  frequency with which the oscillation starts at the beginning of the range;
                      None where the loop is unstable without a delay
    """

    start_s: float
    end_s: float | None
    shakes_at_hz: float | None


class SampledFeedback(NamedTuple):
    """F, g and h as above; ``cycle_s`` is T."""

    f: Matrix
    g: Matrix
    h: Matrix
    cycle_s: float


def sampled_feedback(
    wheel: LinearSystem,
    road: LinearSystem,
    cycle_s: float,
    law: SampledLaw = PASS_THROUGH,
    sensed: Matrix | None = None,
) -> SampledFeedback:
    """Return the loop, cut where the bus is; no torque of the driver but by his grip.

    ``sensed``  of ``sensed_torque``; None where the law does not read the driver's torque
    """
    (a, b, c), (a_road, b_road, c_road) = (zero_order_hold(part, cycle_s) for part in (wheel, road))
    of_angle, of_road, of_driver = law.b.T
    by_angle, by_road, _ = law.d
    f = block_diag(a + by_angle * np.outer(b, c), a_road, law.a)
    first, last = len(b), len(b) + len(b_road)
    f[first:last, :first] = np.outer(b_road, c)
    f[:first, last:], f[last:, :first] = np.outer(b, law.c), np.outer(of_angle, c)
    if sensed is not None:
        f[last:, :first] += np.outer(of_driver, sensed)
    g = np.concatenate((by_road * b, np.zeros(len(b_road)), of_road))
    h = np.concatenate((np.zeros(first), c_road, np.zeros(len(law.c))))
    return SampledFeedback(f, g, h, cycle_s)


def unstable_round_trips(loop: SampledFeedback, up_to_s: float) -> tuple[UnstableRange, ...]:
    """Return every range of unstable round trips up to ``up_to_s``, exact at whole cycles."""
    closed = loop.f + np.outer(loop.g, loop.h)
    unstable = int(np.count_nonzero(np.abs(np.linalg.eigvals(closed)) > 1.0 + 1e-9))
    ranges = []
    start: tuple[float, float | None] | None = (0.0, None) if unstable else None
    for round_trip_s, change, omega_rad_s in sorted(_crossings(loop, up_to_s)):
        unstable += change
        if unstable and start is None:
            start = round_trip_s, omega_rad_s / (2.0 * pi)
        elif not unstable and start is not None:
            ranges.append(UnstableRange(start[0], round_trip_s, start[1]))
            start = None
    if start is not None:
        ranges.append(UnstableRange(start[0], None, start[1]))
    return tuple(ranges)


def is_unstable_at(ranges: Iterable[UnstableRange], round_trip_s: float) -> bool:
    """Whether a round trip is in one of the ranges."""
    return any(
        low <= round_trip_s and (high is None or round_trip_s < high) for low, high, _ in ranges
    )


def tolerated_jitter_s(loop: SampledFeedback, round_trip_s: float) -> float:
    """Return by how much the round trip may vary above a whole number of cycles, in any pattern.

    0 where the loop is unstable at that round trip itself. A sufficient bound, by small gain: with
    T = L z^-n/(1 - L z^-n), a delay between n and n + N cycles is stable if N |T (z - 1)| < 1 on
    the unit circle (C.-Y. Kao and B. Lincoln, Simple stability criteria for systems with
    time-varying delays, Automatica 40(8), 2004).
    """
    at_s = round(round_trip_s / loop.cycle_s) * loop.cycle_s
    if is_unstable_at(unstable_round_trips(loop, at_s), at_s):
        return 0.0
    omegas = _grid(loop)
    open_loop = _response_of(loop)(omegas) * np.exp(-1j * omegas * at_s)
    gains = np.abs(open_loop / (1.0 - open_loop) * (np.exp(1j * omegas * loop.cycle_s) - 1.0))
    return loop.cycle_s / float(gains.max())


def _crossings(loop: SampledFeedback, up_to_s: float) -> Iterator[tuple[float, int, float]]:
    """Yield round trip [s], change of the number of unstable roots, and frequency [rad/s]."""
    omegas, response = _grid(loop), _response_of(loop)
    gains = np.abs(response(omegas))
    for place in np.flatnonzero((gains[:-1] > 1.0) != (gains[1:] > 1.0)):
        low, high = omegas[place], omegas[place + 1]
        falls = gains[place] > 1.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if (abs(response(np.array([middle]))[0]) > 1.0) == falls:
                low = middle
            else:
                high = middle
        angle = float(np.angle(response(np.array([low]))[0])) % (2.0 * pi)
        round_trip_s = angle / low
        while round_trip_s <= up_to_s:
            yield round_trip_s, 2 if falls else -2, float(low)
            round_trip_s += 2.0 * pi / low


def _grid(loop: SampledFeedback) -> Matrix:
    """Return frequencies up to half of the sampling's, with those near the poles [rad/s]."""
    poles = np.log(np.linalg.eigvals(loop.f).astype(complex) + 1e-300) / loop.cycle_s
    grid = np.geomspace(_FREQUENCY_MIN_RAD_S, pi / loop.cycle_s, _FREQUENCIES)
    near = np.abs(poles.imag)[:, np.newaxis] + np.abs(poles.real)[:, np.newaxis] * [-1, 0, 1]
    near = near[(near > grid[0]) & (near < grid[-1])]
    return np.unique(np.concatenate((grid, near)))


def _response_of(loop: SampledFeedback) -> Callable[[Matrix], ComplexArray]:
    """Return L over frequencies [rad/s], by one Schur form of F for all of them."""
    whole = linear_system.LinearSystem(loop.f, loop.g[:, np.newaxis], loop.h, np.zeros(1))
    response = linear_system.triangular(whole).response
    return lambda omegas_rad_s: response(np.exp(1j * omegas_rad_s * loop.cycle_s))[0]


def spring_torque(road: LinearSystem, gradient_n_m: float) -> LinearSystem:
    """Return a road whose torque is that of a spring, which the road wheels stretch."""
    of_wheel = np.zeros(len(road.c))
    of_wheel[0] = gradient_n_m
    return road._replace(c=of_wheel)


def feedback_loop(
    plant: PlantSettings, wheel: HandWheelSettings, added_n_m_s: float = 0.0
) -> SampledFeedback | None:
    """Return the loop of a pair's hand wheel, linear and without friction; None for no bus in it.

    ``added_n_m_s``  damping of the wheel besides its own

    A car is taken as its [vehicle], with the lag of its [actuator] and the relaxation of its tyres.
    """
    law, vehicle = wheel.feedback, road_vehicle(plant.vehicle, plant.car)
    if law.law == "model":
        return None
    road = road_torque(vehicle, law.torque_gradient_n_m, Rack(lag_s=plant.actuator.lag_s))
    if law.law == "spring":
        road = spring_torque(road, law.torque_gradient_n_m)
    damping_n_m_s = wheel.wheel.damping_n_m_s + law.damping_n_m_s + added_n_m_s
    damped = wheel.wheel.model_copy(update={"damping_n_m_s": damping_n_m_s})
    grip, sampled = GRIPS[wheel.driver.grip], PASS_THROUGH
    if law.law == "dob":
        known = law.dob_inertia_kg_m2, law.dob_damping_n_m_s
        sampled = sampled_dob(*known, wheel.cycle_s, law.cutoff_rad_s)
    if law.law == "cdob":
        sampled = sampled_cdob(
            wheel.nominal_way, wheel.cycle_s, law.cutoff_rad_s, law.washout_rad_s
        )
    sensed = sensed_torque(damped, grip)
    return sampled_feedback(held_wheel(damped, grip), road, wheel.cycle_s, sampled, sensed)


class Threshold(NamedTuple):
    """A swing of the hand wheel from which on swings grow, while most smaller ones die down."""

    amplitude_rad: float
    frequency_hz: float


def friction_threshold(
    plant: PlantSettings, wheel: HandWheelSettings, round_trip_s: float
) -> Threshold | None:
    """Return the swing above which friction holds none in an unstable loop; None for other loops.

    Runs hold a median of 0.92 of it, and up to 1.03 (``tests.searches.friction_holds``).

    ``round_trip_s``  a whole number of cycles
    """
    (low, high), friction_n_m = _DAMPINGS_N_M_S, wheel.wheel.friction_n_m

    def shakes(added_n_m_s: float) -> bool:
        loop = feedback_loop(plant, wheel, added_n_m_s)
        return loop is not None and is_unstable_at(
            unstable_round_trips(loop, round_trip_s), round_trip_s
        )

    if not friction_n_m or not shakes(low) or shakes(high):
        return None
    for _ in range(_DAMPING_BISECTIONS):
        middle = sqrt(low * high)
        low, high = (middle, high) if shakes(middle) else (low, middle)
    margin = feedback_loop(plant, wheel, high)
    crossings = [] if margin is None else [*_crossings(margin, round_trip_s + margin.cycle_s)]
    if not crossings:  # at no delay the crossing may lie just below it
        return None
    _, _, omega_rad_s = min(crossings, key=lambda each: abs(each[0] - round_trip_s))
    return Threshold(4.0 * friction_n_m / (pi * high * omega_rad_s), omega_rad_s / (2.0 * pi))


def computed_text(plant: PlantSettings, wheel: HandWheelSettings) -> str:
    """Return from which round trip on the hand wheel of a pair shakes, in words."""
    loop = feedback_loop(plant, wheel)
    if loop is None:
        return "computed: the law needs no bus"
    ranges = unstable_round_trips(loop, UP_TO_S)
    if not ranges:
        return f"computed: stable at any round trip up to {UP_TO_S:g} s"
    first_ms = 1e3 * ranges[0].start_s
    text = f"computed: unstable from a round trip of {first_ms:.0f} ms on, without friction"
    lines = plant.latency.downlink, plant.latency.uplink
    if any(line.schedule or line.has_trace for line in lines):
        return text
    cycles = round(sum(line.mean_s for line in lines) / wheel.cycle_s)
    if (threshold := friction_threshold(plant, wheel, cycles * wheel.cycle_s)) is None:
        return text
    return (
        f"{text}; at {1e3 * cycles * wheel.cycle_s:.0f} ms its friction holds swings of at most"
        f" about ±{threshold.amplitude_rad:.2g} rad, and some smaller ones grow too"
    )
