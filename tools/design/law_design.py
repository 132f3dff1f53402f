"""Design of one law: search, confirmation, and its figures."""

from typing import NamedTuple

import numpy as np

from ...controller.laws.law_from_settings import required
from ...controller.settings import ControllerSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS
from .demands import Bench, Demand, Judgement, driven, make_bench, runs_at
from .search.law_parameters import SETTINGS_KEYS, controller_settings, with_set_point
from .search.parameter_search import Found, find
from .specification import Specification
from .vehicle_file import VehicleFile
from .virtual_check import drive, jittered, plants

_MEANINGS = {
    "settling": "a mode slower than sigma",
    "delay margin": "unstable within the delay margin",
    "actuator lag": "unstable behind the actuator lag",
    "PD settling": "PD alone slower than sigma",
    "PD damping": "PD alone outside the cone",
    "PD bandwidth": "PD alone beyond the bandwidth R",
}
"""Text for a failed demand that is not a number."""
NUMBER_UNITS = {
    "RMS error": " m",
    "peak sensitivity": "",
    "noise gain": " rad/m",
    "steer": " rad",
    "steer rate": " rad/s",
}


class Design(NamedTuple):
    """A law that meets all demands.

    ``rms_m``             of the car on the worst path, shape (corners, delays), at all of
    ``rms_delays_ns``     which every corner is stable
    ``rms_held_up_to_ns``  up to which delay the RMS keeps its limit; None where it has none
    ``jitter_rms_m``      worst corner and path of each jitter of the specification, virtual time
    """

    preset: ControllerSettings
    found: Found
    rms_m: FloatArray
    rms_delays_ns: tuple[int, ...]
    rms_held_up_to_ns: int | None
    jitter_rms_m: tuple[float, ...]


def design(spec: Specification, vehicle: VehicleFile, law: str, until_s: float) -> Design | Found:
    """Return the law that is best by the specification; what was found if it is no design.

    ``until_s``  of the monotonic clock: then the best so far is taken
    """
    fine = make_bench(spec, vehicle, fine=True)
    found = find(make_bench(spec, vehicle, fine=False), fine, law, until_s)
    return describe(fine, found) if found.feasible else found


def describe(bench: Bench, found: Found) -> Design:
    """Return everything about a law that has been found."""
    spec, vehicle, law = bench.spec, bench.vehicle, found.law
    settings = controller_settings(spec, vehicle, law, found.values)
    last_ns = max(spec.delays_ns[-1], required(found.confirmation).stable_up_to_ns)
    delays_ns = tuple(sorted({*spec.delays_ns, *spec.delay.up_to_ns(last_ns / NS_PER_MS)}))
    all_runs = bench._replace(runs=runs_at(spec, vehicle, delays_ns))
    of_delays = driven(all_runs, settings).values()
    shape = len(delays_ns), len(spec.course.paths), -1
    rms_m = np.array([[run.rms_m for run in of_delay] for of_delay in of_delays]).reshape(shape)
    by_delay_m = rms_m.max(axis=1).T
    asked = plants(spec, vehicle, map(jittered, spec.jitter))
    preset = with_set_point(spec, settings)
    jitter_m = np.array([drive(spec, plant, preset).rms_m for plant in asked])
    worst_m = jitter_m.reshape(-1, max(1, len(spec.jitter))).max(axis=0, initial=0.0)
    return Design(
        preset,
        found,
        by_delay_m,
        delays_ns,
        _held_up_to_ns(delays_ns, by_delay_m, spec.rms_m_max_of(law)),
        tuple(float(value) for value in worst_m[: len(spec.jitter)]),
    )


def _held_up_to_ns(
    delays_ns: tuple[int, ...], by_delay_m: FloatArray, largest_m: float | None
) -> int | None:
    """Return the last delay before the first at which the RMS is above its limit [ns]."""
    if largest_m is None:
        return None
    beyond = np.flatnonzero(by_delay_m.max(axis=0) > largest_m)
    last = int(beyond[0]) - 1 if len(beyond) else len(delays_ns) - 1
    return delays_ns[last] if last >= 0 else -1


def nearest(found: Found) -> str:
    """Return in words what the search came nearest with, and what that fails."""
    values = found.values.items()
    best = ", ".join(f"{SETTINGS_KEYS[key]} = {value:g}" for key, value in values)
    return f"the nearest ({best}) fails: {'; '.join(failed(found.judgement))}"


def failed(judgement: Judgement) -> list[str]:
    """Return in words which demands are not met."""
    return [failure(demand) for demand in judgement.demands if demand.excess]


def failure(demand: Demand) -> str:
    """Return in words by what a demand is not met."""
    if demand.name in _MEANINGS:
        return _MEANINGS[demand.name]
    unit = NUMBER_UNITS[demand.name]
    return f"{demand.name} {_distinct(demand.value, demand.limit)} above {demand.limit:g}{unit}"


def _distinct(value: float, limit: float) -> str:
    """Return ``value`` with three digits, or with as many as distinguish it from ``limit``."""
    for digits in range(3, 17):
        text = f"{value:.{digits}g}"
        if float(text) != limit:
            break
    return text
