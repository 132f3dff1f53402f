"""The predictor's centre of gravity in the interior of the box of vehicles.

The comparison's runs are at the corners, and the worst vehicle may lie between them.
"""

from typing import NamedTuple

from scipy.stats import qmc

from ...compiled.engine import Outcome, run_batch
from ...loop_theory.uncertainty import paper_box
from ...pair.trace import rms
from .runs import (
    CONTESTANTS,
    NETWORKS,
    OFF_PATH_M,
    SETTLED_S,
    Contestant,
    controller_settings,
    plant_settings,
)

DELAY_S_MAX = 0.5
_SEED = 1
PREDICTORS = tuple(one for one in CONTESTANTS if one.label in ("predictor", "predictor, CG"))
"""One follows the preview point, the other the centre of gravity."""


class Point(NamedTuple):
    """A vehicle and a constant delay, and the RMS of its centre of gravity from SETTLED_S on."""

    cg_rms_m: float
    speed_m_s: float
    virtual_mass_kg: float
    delay_s: float


def interior_points(count: int, duration_s: float, contestant: Contestant) -> list[Point]:
    """Return points of a Sobol sequence over speed, mass and delay, the worst first."""
    vertices = paper_box().vertices()
    speeds = [vehicle.speed_m_s for vehicle in vertices]
    masses = [vehicle.virtual_mass_kg for vehicle in vertices]
    unit = qmc.Sobol(3, seed=_SEED).random_base2(max(count - 1, 0).bit_length())[:count]
    low, high = (min(speeds), min(masses), 0.0), (max(speeds), max(masses), DELAY_S_MAX)
    places = qmc.scale(unit, low, high).tolist()
    points = (
        _point(speed_m_s, mass_kg, delay_s, duration_s, contestant)
        for speed_m_s, mass_kg, delay_s in places
    )
    return sorted(points, reverse=True)


def interior_line(contestant: Contestant, points: list[Point]) -> str:
    """Return what to know of them."""
    worst, median = points[0], points[len(points) // 2]
    return (
        f"{contestant.label}, {len(points)} points inside the box, delay up to {DELAY_S_MAX:g} s:"
        f" centre of gravity RMS from {SETTLED_S:g} s on {1e3 * worst.cg_rms_m:.2f} mm at most"
        f" ({3.6 * worst.speed_m_s:.2f} km/h, {worst.virtual_mass_kg:.0f} kg,"
        f" {1e3 * worst.delay_s:.0f} ms), median {1e3 * median.cg_rms_m:.2f} mm"
    )


def _point(
    speed_m_s: float, mass_kg: float, delay_s: float, duration_s: float, contestant: Contestant
) -> Point:
    plant = plant_settings(NETWORKS["constant"], delay_s, "a", 1, duration_s)
    vehicle = {"speed_m_s": speed_m_s, "virtual_mass_kg": mass_kg}
    plant = plant.model_copy(update={"vehicle": plant.vehicle.model_copy(update=vehicle)})
    run = run_batch(plant, controller_settings(contestant, has_lag=False))
    is_settled = run.time_s >= SETTLED_S
    is_complete = run.outcome is Outcome.COMPLETE
    cg_rms_m = rms(run.cg_deviation_m[is_settled]) if is_complete else OFF_PATH_M
    return Point(cg_rms_m, speed_m_s, mass_kg, delay_s)
