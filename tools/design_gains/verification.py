"""Every corner and every delay of a design in virtual time, against the linear analysis."""

from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from ...runtime.node import NS_PER_MS
from .design import Design
from .specification import Specification
from .vehicle_file import VehicleFile
from .virtual_check import constant, drive, drives

_CHUNK = 8


class Verification(NamedTuple):
    """The results of all runs.

    ``rms_m``      the largest RMS, and the delay at which it was
    ``steer_rad``  the largest steer
    ``deviation``  the largest difference to the linear analysis, of the RMS it gives
    """

    runs: int
    rms_m: float
    delay_ns: int
    steer_rad: float
    deviation: float
    held: bool


def verify(
    pool: Executor, spec: Specification, vehicle: VehicleFile, design: Design
) -> Verification:
    """Run the range of delays at all corners and on all paths."""
    asked = drives(spec, vehicle, design.settings, map(constant, spec.delays_ns))
    driven = list(pool.map(drive, asked, chunksize=_CHUNK))
    shape = (len(spec.course.paths), len(vehicle.box.vertices()), len(spec.delays_ns))
    rms_m = np.array([run.rms_m for run in driven]).reshape(shape).max(axis=0)
    columns = [design.rms.delays_ns.index(delay_ns) for delay_ns in spec.delays_ns]
    linear_m = design.rms.rms_m[:, columns]
    steer_rad = max(run.steer_rad for run in driven)
    largest_m = spec.rms_m_max_of(design.law)
    worst = int(rms_m.max(axis=0).argmax())
    return Verification(
        len(driven),
        float(rms_m.max()),
        spec.delays_ns[worst],
        steer_rad,
        float(np.abs(rms_m / linear_m - 1.0).max()),
        (largest_m is None or float(rms_m.max()) <= largest_m)
        and steer_rad < spec.limits.steer_rad_max,
    )


def verification_line(spec: Specification, design: Design, found: Verification) -> str:
    """Return the result of the runs in virtual time in one line."""
    largest_m = spec.rms_m_max_of(design.law)
    limit = "" if largest_m is None else f", at most {largest_m:g} m"
    return (
        f"  virtual time      {found.runs} runs: RMS at most {found.rms_m:.4g} m"
        f" (at {found.delay_ns // NS_PER_MS} ms{limit}),"
        f" steer at most {found.steer_rad:.3g} rad;"
        f" within {100.0 * found.deviation:.2g} % of the linear analysis:"
        f" {'held' if found.held else 'NOT HELD'}"
    )
