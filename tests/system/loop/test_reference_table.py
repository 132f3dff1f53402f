"""The whole loop in virtual time against an independent simulation of the same loop.

The reference has a 100 Hz controller and a plant integrated in steps of 1 ms. It drives 60 s of an
ellipse with semi-axes 60 m and 30 m, the steer limited to 0.6 rad, and prints the worst RMS [m] of
the four corners of the uncertainty box. Compared are its stable cells, with compiled runs, which
are bit for bit those of the two nodes in virtual time (``test_compiled_run``).
"""

from typing import NamedTuple

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.filters.settings import CdobSettings, DobSettings, PdSettings
from steer_by_wire.controller.limits.steer_limits import LimitSettings
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import EllipseSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from tests.support.loops.own_vehicle import VEHICLE

PERIOD_NS = 10_000_000
DURATION_S = 60
STEER_RAD_MAX = 0.6

Corner = tuple[float, float]
"""Speed [km/h] and virtual mass [kg]."""
CORNERS: tuple[Corner, ...] = ((4.0, 1600.0), (4.0, 5000.0), (7.0, 1600.0), (7.0, 5000.0))

MODEL = VEHICLE.model_copy(
    update={"front_cornering_stiffness_n_rad": 195e3, "preview_distance_m": 1.912}
)


class Row(NamedTuple):
    """One line of the reference: a law, the cutoffs of its filters [rad/s], and RMS by latency."""

    law: str
    derivative_filter: float
    dob: float | None
    cdob: float | None
    washout: float | None
    rms_m: tuple[float | None, ...]  # None: a limit cycle


Latency = tuple[float, float]
"""Mean and standard deviation [s]."""
LATENCIES: tuple[Latency, ...] = (
    (0.0, 0.0),
    (0.08, 0.0),
    (0.08, 0.03),
    (0.16, 0.0),
    (0.16, 0.05),
    (0.25, 0.0),
    (0.35, 0.0),
)
PD, PD_DOB, PD_CDOB, PD_DDOB = "pd", "pd_dob", "pd_cdob", "pd_ddob"
REFERENCE = (
    Row(PD, 20, None, None, None, (0.072, None, None, None, None, None, None)),
    Row(PD, 5, None, None, None, (0.072, 0.072, 0.072, None, 0.072, None, None)),
    Row(PD, 2, None, None, None, (0.072, 0.072, 0.072, 0.072, 0.072, None, None)),
    Row(PD_DOB, 2, 5, None, None, (0.0038, 0.0038, 0.0038, None, 0.0038, None, None)),
    Row(PD_DOB, 2, 2, None, None, (0.0088, 0.0088, 0.0088, 0.0089, 0.0088, None, None)),
    Row(PD_CDOB, 5, None, 20, 3, (0.078, 0.078, 0.078, 0.078, 0.078, 0.078, 0.078)),
    Row(PD_CDOB, 20, None, 50, 3, (0.078, None, None, None, 0.078, None, None)),
    Row(PD_DDOB, 2, 5, 20, 3, (0.0042, 0.0042, 0.0042, 0.0045, 0.0043, None, None)),
    Row(PD_DDOB, 5, 2, 20, 3, (0.0098, 0.0099, 0.0099, 0.0099, 0.0099, 0.0101, None)),
    Row(PD_DDOB, 2, 2, 10, 3, (0.0098, 0.0098, 0.0098, 0.0099, 0.0098, 0.0101, None)),
    Row(PD_DDOB, 2, 2, 10, 1, (0.0172, 0.0173, 0.0173, 0.0175, 0.0173, 0.0178, 0.0187)),
)


class Cell(NamedTuple):
    row: Row
    latency: Latency
    rms_m: float


def controller_settings(row: Row) -> ControllerSettings:
    return ControllerSettings(
        law=row.law,
        pd=PdSettings(
            proportional_gain_rad_m=1.0596,
            derivative_gain_rad_s_m=0.939,
            derivative_filter_rad_s=row.derivative_filter,
        ),
        dob=None if row.dob is None else DobSettings(q_cutoff_rad_s=row.dob),
        cdob=None
        if row.cdob is None
        else CdobSettings(q_cutoff_rad_s=row.cdob, washout_rad_s=row.washout),
        nominal_model=MODEL,
        # The reference has no limit on the steering rate.
        limits=LimitSettings(steer_rad_max=STEER_RAD_MAX, steer_rate_rad_s_max=1000.0),
    )


def plant_settings(latency: Latency, corner: Corner) -> PlantSettings:
    mean_s, spread_s = latency
    model = Distribution.NORMAL if spread_s else Distribution.CONSTANT
    speed_km_h, virtual_mass_kg = corner
    return PlantSettings(
        duration_s=DURATION_S,
        vehicle=VehicleSettings(
            speed_m_s=speed_km_h / 3.6,
            virtual_mass_kg=virtual_mass_kg,
            front_cornering_stiffness_n_rad=MODEL.front_cornering_stiffness_n_rad,
            preview_distance_m=MODEL.preview_distance_m,
        ),
        path=EllipseSettings(semi_major_axis_m=60.0, semi_minor_axis_m=30.0),
        latency=BothLatencySettings(
            downlink=LatencySettings(model=model, mean_s=mean_s, spread_s=spread_s)
        ),
    )


STABLE_CELLS = tuple(
    Cell(row, latency, rms_m)
    for row in REFERENCE
    for latency, rms_m in zip(LATENCIES, row.rms_m, strict=True)
    if rms_m is not None
)


def name_of(cell: Cell) -> str:
    row, (mean_s, spread_s), _ = cell
    cutoffs = [row.derivative_filter, row.dob, row.cdob, row.washout]
    filters = "-".join(f"{cutoff:g}" for cutoff in cutoffs if cutoff is not None)
    return f"{row.law}-{filters}-at-{1e3 * mean_s:g}({1e3 * spread_s:g})ms"


@pytest.mark.parametrize("cell", STABLE_CELLS, ids=name_of)
def test_virtual_time_agrees_with_an_independent_simulation(cell: Cell) -> None:
    controller = controller_settings(cell.row)
    runs = [run_compiled(plant_settings(cell.latency, corner), controller) for corner in CORNERS]
    worst_m = max(run.preview_rms_m for run in runs)
    assert worst_m == pytest.approx(cell.rms_m, rel=0.05)
    # So that what is compared is the loop, and not its limit.
    assert max(np.abs(run.sent_rad).max() for run in runs) < STEER_RAD_MAX
