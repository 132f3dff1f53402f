"""Frontier of feedback laws: what each changes of the road's message, at the round trip it bears.

Every law is taken with the settings that change the message least, out of those that

- keep the wheel still without hands, at the round trip and at JITTER more, with the road's true
  torque gradient at each of GRADIENT_FACTORS of the nominal one
- make no more torque noise than all others, from an encoder of ENCODER_STEP_RAD

``changed`` is the error of the torque that the driver feels as he moves the wheel, against the
road's own without a bus, RMS over BAND_HZ; ``late_s`` is when 63 % of a change of the road's force
have reached a hand that holds still, for good. Passivity is that of a controller, found by runs.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property, lru_cache, partial
from itertools import islice, product
from math import inf, pi, radians, sqrt
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steer_by_wire.closed_loop.pair.pair_result import rms
from steer_by_wire.closed_loop.scripting.feedback import (
    SampledFeedback,
    UnstableRange,
    sampled_feedback,
    spring_torque,
    unstable_round_trips,
)
from steer_by_wire.hand_wheel.analysis.nominal_road import Rack, RoadVehicle, road_torque
from steer_by_wire.hand_wheel.analysis.sampled_laws import (
    PASS_THROUGH,
    SampledLaw,
    model_alone,
    sampled_cdob,
    sampled_dob,
)
from steer_by_wire.hand_wheel.wheel import GRIPS, LinearSystem, WheelSettings, held_wheel

ROUND_TRIPS_S = (0.004, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
GRADIENT_FACTORS = (0.6, 1.0, 1.4)
JITTER = 0.3
ENCODER_STEP_RAD = radians(0.1)
"""Usual for sensors of a steering angle."""
BAND_HZ = (0.3, 3.0)
"""In which drivers steer: chosen."""
BAND_RAD_S = 2.0 * pi * np.geomspace(*BAND_HZ, 24)
_RATE_CUTOFFS_RAD_S = np.geomspace(2000.0, 3.0, 60)
_DAMPINGS_N_M_S = (0.0, *np.geomspace(0.02, 6.0, 30).tolist())
_CUTOFFS_RAD_S = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
_WASHOUTS_RAD_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
_CDOB_DAMPINGS_N_M_S = (0.0, 0.03, 0.1, 0.2, 0.4)
_TRIED = 6
"""So many settings of a law are run, until one holds in all conditions."""
_LATE_S_MAX = 4.0
_NOISE_FREQUENCIES = 300


class Bench(NamedTuple):
    """What every law is tried on; ``noise_n_m`` is the torque noise that it may make, RMS.

    ``grip``  one of GRIPS
    """

    vehicle: RoadVehicle
    gradient_n_m: float
    rack: Rack
    wheel: WheelSettings
    cycle_s: float
    noise_n_m: float
    grip: str = "hands_off"

    def road(self, factor: float = 1.0, grip: float = 1.0) -> LinearSystem:
        """Return the road's torque at a multiple of the gradient, and with less grip."""
        vehicle = self.vehicle
        vehicle = vehicle._replace(
            front_cornering_stiffness_n_rad=grip * vehicle.front_cornering_stiffness_n_rad,
            rear_cornering_stiffness_n_rad=grip * vehicle.rear_cornering_stiffness_n_rad,
        )
        return road_torque(vehicle, factor * grip * self.gradient_n_m, self.rack)

    def spring(self, grip: float = 1.0) -> LinearSystem:
        """Return the torque of a spring that the road wheels stretch; all of it is nominal."""
        return spring_torque(self.road(1.0, grip), self.gradient_n_m)

    def loop(self, design: "Design", factor: float, grip: float = 1.0) -> SampledFeedback:
        """Return the loop of a design."""
        road = self.spring(grip) if design.is_spring else self.road(factor, grip)
        return sampled_feedback(self.held, road, self.cycle_s, design.law)

    @property
    def held(self) -> LinearSystem:
        """The wheel in the driver's hands."""
        return held_wheel(self.wheel, GRIPS[self.grip])


class Design(NamedTuple):
    """A law with settings, in words.

    ``passive_n_m_s``  damping of a passivity controller: what always acts, and what it adds at most
    """

    settings: str
    law: SampledLaw
    is_spring: bool = False
    passive_n_m_s: tuple[float, float] = (inf, 0.0)


class Point(NamedTuple):
    """A law at one round trip.

    ``changed``  infinite where no settings hold
    ``local``    share of the felt torque that is made at the wheel, without the road
    ``fails``    conditions of the runs in which the wheel is not still
    """

    law: str
    round_trip_s: float
    changed: float = inf
    late_s: float = inf
    local: float = 0.0
    design: Design | None = None
    fails: tuple[str, ...] = ()


class Candidate:
    """A design on the bench; its figures are computed once, as they are needed."""

    def __init__(self, bench: Bench, design: Design) -> None:
        self._bench, self.design = bench, design

    @cached_property
    def _unstable(self) -> list[UnstableRange]:
        longest_s = (1.0 + JITTER) * ROUND_TRIPS_S[-1]
        loops = (self._bench.loop(self.design, factor) for factor in GRADIENT_FACTORS)
        return [part for loop in loops for part in unstable_round_trips(loop, longest_s)]

    @cached_property
    def _responses(self) -> NDArray[np.complex128]:
        return responses(self.design.law, BAND_RAD_S, self._bench.cycle_s)

    def holds(self, round_trip_s: float) -> bool:
        """Whether the wheel is still at every round trip up to JITTER more."""
        last_s = (1.0 + JITTER) * round_trip_s
        return all(
            last_s < part.start_s or (part.end_s is not None and part.end_s <= round_trip_s)
            for part in self._unstable
        )

    def changed(self, round_trip_s: float) -> tuple[float, float]:
        """Return error and local share of the felt torque, at the worst gradient."""
        by_angle, by_road, by_driver = self._responses
        wheel = self._bench.wheel
        moved = wheel.damping_n_m_s * 1j * BAND_RAD_S - wheel.inertia_kg_m2 * BAND_RAD_S**2
        local = by_angle + by_driver * moved
        late = by_road * np.exp(-1j * BAND_RAD_S * round_trip_s)
        worst = 0.0, 0.0
        for factor in GRADIENT_FACTORS:
            ideal = road_response(self._bench, factor)
            road = late * road_response(self._bench, 0.0 if self.design.is_spring else factor)
            felt = (local + road) / (1.0 - by_driver)
            share = rms(local) / (rms(local) + rms(road))
            worst = max(worst, (rms(felt - ideal) / rms(ideal), share))
        return worst

    def late_s(self, round_trip_s: float) -> float:
        """Return when a held hand has 63 % of a step of the road's force for good."""
        a, b, c, d = self.design.law
        if self.design.is_spring:
            return inf
        cycle_s = self._bench.cycle_s
        # A hand that holds still pushes back with what it feels: T_d = T.
        d_road, c_held = d[1] / (1.0 - d[2]), c / (1.0 - d[2])
        state, late = np.zeros(len(c)), 0
        for cycle in range(round(_LATE_S_MAX / cycle_s)):
            felt = float(c_held @ state + d_road)
            late = cycle + 1 if felt < 1.0 - np.exp(-1.0) else late
            state = a @ state + b[:, 1] + b[:, 2] * felt
        late_s = late * cycle_s
        return inf if late_s >= _LATE_S_MAX - cycle_s else 0.5 * round_trip_s + late_s


def best_points(bench: Bench) -> Iterator[list[Point]]:
    """Yield the best points of each law and round trip, but of the passivity controller.

    The first of them changes the message least; one that no settings hold is a point too.
    """
    for name, designs in _families(bench).items():
        candidates = [Candidate(bench, design) for design in designs]
        for at_s in ROUND_TRIPS_S:
            scored = [(*candidate.changed(at_s), candidate) for candidate in candidates]
            scored.sort(key=itemgetter(0))
            holding = (each for each in scored if each[2].holds(at_s))
            yield [
                Point(name, at_s, changed, candidate.late_s(at_s), local, candidate.design)
                for changed, local, candidate in islice(holding, _TRIED)
            ] or [Point(name, at_s)]


def _families(bench: Bench) -> Mapping[str, Iterable[Design]]:
    return {
        "force as it arrives, damped": damped(bench, PASS_THROUGH, "", _DAMPINGS_N_M_S),
        "spring": (
            design._replace(is_spring=True)
            for design in damped(bench, PASS_THROUGH, "", _DAMPINGS_N_M_S)
        ),
        "model": [Design("no road", model_alone(bench.road(), bench.cycle_s))],
        "DOB": _observed(bench),
        "CDOB": (
            design
            for cutoff, washout in product(_CUTOFFS_RAD_S, _WASHOUTS_RAD_S)
            for design in damped(
                bench,
                sampled_cdob(bench.road(), bench.cycle_s, cutoff, washout),
                f"{cutoff:g} rad/s, washout {washout:g}, ",
                _CDOB_DAMPINGS_N_M_S,
            )
        ),
    }


def damped(
    bench: Bench, law: SampledLaw, words: str, dampings_n_m_s: Iterable[float]
) -> Iterator[Design]:
    """Yield a law with each damping that the noise allows, its rate filtered little."""
    for damping in dampings_n_m_s:
        if not damping:
            yield Design(f"{words}no damping", law)
            continue
        by_rate = partial(law.with_damping, damping, bench.cycle_s)
        for cutoff, quiet in _quiet(bench, by_rate):
            yield Design(f"{words}{damping:.2g} N m s/rad ({cutoff:.0f} rad/s)", quiet)


def _observed(bench: Bench) -> Iterator[Design]:
    for factor, damping in product((0.3, 1.0), _DAMPINGS_N_M_S[1:]):
        inertia = factor * bench.wheel.inertia_kg_m2
        for cutoff, law in _quiet(bench, partial(sampled_dob, inertia, damping, bench.cycle_s)):
            yield Design(f"{cutoff:.0f} rad/s, {factor:g} J, {damping:.2g} N m s/rad", law)


def _quiet(
    bench: Bench, law_of: Callable[[float], SampledLaw]
) -> Iterator[tuple[float, SampledLaw]]:
    """Yield the largest cutoff [rad/s] at which a law is no noisier than it may be, and the law."""
    for cutoff in _RATE_CUTOFFS_RAD_S.tolist():
        if torque_noise_n_m(bench, law := law_of(cutoff)) <= bench.noise_n_m:
            yield cutoff, law
            return


def passivity_controllers(bench: Bench) -> Iterator[Design]:
    """Yield passivity controllers, whose largest damping counts for the noise."""
    for least, most in product((0.02, 0.1, 0.3), (0.3, 1.0, 3.0)):
        for design in damped(bench, PASS_THROUGH, "", [least + most]):
            share = least / (least + most)
            law = design.law
            law = law._replace(c=law.c * share, d=law.d * np.array([share, 1.0, 1.0]))
            words = f"{least:g} N m s/rad, at most {most:g} more"
            yield Design(words, law, passive_n_m_s=(least, most))


def torque_noise_n_m(bench: Bench, law: SampledLaw) -> float:
    """Return the torque that the encoder's steps make behind the motor's lag, RMS [N m]."""
    shares = (np.arange(_NOISE_FREQUENCIES) + 0.5) / _NOISE_FREQUENCIES
    omegas = shares * pi / bench.cycle_s  # up to half of the sampling's
    by_angle = responses(law, omegas, bench.cycle_s)[0]
    behind = by_angle / (1.0 + 1j * omegas * bench.wheel.motor_lag_s)
    return ENCODER_STEP_RAD / sqrt(12.0) * rms(behind)


def responses(
    law: SampledLaw, omegas: NDArray[np.float64], cycle_s: float
) -> NDArray[np.complex128]:
    """Return the law's torque by angle, road and driver over frequencies [rad/s]; shape (3, n)."""
    z = np.exp(1j * omegas * cycle_s)
    size = len(law.c)
    states = np.linalg.solve(z[:, None, None] * np.eye(size) - law.a, law.b + 0j)
    return np.asarray((law.c @ states + law.d).T, np.complex128)


@lru_cache
def road_response(bench: Bench, factor: float) -> NDArray[np.complex128]:
    """Return the road's torque by the wheel's angle over BAND_RAD_S, without a bus.

    ``factor``  times the gradient; 0: that of a spring
    """
    road = model_alone(bench.road(factor) if factor else bench.spring(), bench.cycle_s)
    by_angle: NDArray[np.complex128] = responses(road, BAND_RAD_S, bench.cycle_s)[0]
    return by_angle
