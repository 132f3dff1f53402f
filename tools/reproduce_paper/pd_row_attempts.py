"""Other readings of the text that could explain Table II's PD row, and their results.

initial offset   no path at all: the vehicle starts beside a straight road. One free number,
                 the offset, at the best fit
J V²             a22 as misprinted in (2), which (19) has, on the inferred ellipse
"""

from collections.abc import Iterator

import numpy as np
from scipy.signal import StateSpace, lsim

from ...loop_theory.uncertainty import paper_box
from ...pair.trace import rms
from ...plant_emulator.vehicle import VehicleParams, state_matrices
from ...runtime.array_types import FloatArray
from . import published
from .continuous_runs import K_D_RAD_S_M, K_P_RAD_M, curvature_met
from .table_2_attempts import PATH

_PER_METRE = np.array([0.0, 0.0, 0.0, 1.0])


def pd_row_attempts() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield each reading's description and its row [m]."""
    of_one_metre = np.array([_rms_m(vehicle, offset_m=1.0) for vehicle in _corners()])
    published_m = np.array([column.pd_m for column in published.TABLE_2])
    offset_m = float(of_one_metre @ published_m / (of_one_metre @ of_one_metre))
    row_m = tuple(float(value) for value in offset_m * of_one_metre)
    yield f"initial offset of {offset_m:.2f} m beside a straight road", row_m
    misprinted = tuple(_rms_m(vehicle, has_misprint=True) for vehicle in _corners())
    yield "a22 with J V² as printed, on the ellipse", misprinted


def _corners() -> list[VehicleParams]:
    return [VehicleParams(vehicle.speed_m_s, *vehicle[:-1]) for vehicle in paper_box().vertices()]


def _rms_m(vehicle: VehicleParams, offset_m: float = 0.0, *, has_misprint: bool = False) -> float:
    """Return the RMS of the continuous PD loop, from an offset or else along the ellipse."""
    a, b = state_matrices(vehicle)
    if has_misprint:
        a[1, 1] /= vehicle.speed_m_s
    closed = a - np.outer(b[:, 0], K_P_RAD_M * _PER_METRE + K_D_RAD_S_M * a[3])
    time_s, curvature_1_m = curvature_met(vehicle.speed_m_s, PATH)
    driven: FloatArray = np.zeros_like(curvature_1_m) if offset_m else curvature_1_m
    loop = StateSpace(closed, b[:, 1:2], _PER_METRE[np.newaxis], np.zeros((1, 1)))
    _, error_m, _ = lsim(loop, driven, time_s, X0=offset_m * _PER_METRE)
    return rms(np.asarray(error_m, dtype=np.float64))
