"""Delays that a controller survives with an identified car, over the interval of all parameters.

Cars are drawn from the covariance of the fit; the controller is designed for the car in the middle.
"""

from typing import NamedTuple

import numpy as np

from ...controller.analysis.check_figures import loop_around
from ...controller.analysis.stable_delays import least_margin_ns
from ...controller.filters.nominal_model import NominalVehicle
from ...controller.settings import PRESETS, ControllerSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ...runtime.settings import SharedTable, load_settings, read_preset
from .figures import user_name
from .fit import Fit, Progress, Stopped, quiet
from .parameters import car_tables

DRAWS = 40
_SEED = 1
FAST_M_S = 8.0


class DelayMargin(NamedTuple):
    """Constant delay at which stability is first lost [s], and its interval of 95 %.

    ``narrows``  the parameter that the margin depends on most
    ``share``    of the margin's variance that goes with it
    """

    controller: str
    margin_s: float
    low_s: float
    high_s: float
    narrows: str
    share: float


def delay_margin(
    found: Fit, speed_m_s: float, controller: str | None = None, progress: Progress = quiet
) -> DelayMargin | None:
    """Return the margin of a controller's preset, or nothing once stopped.

    By default it is a PD of the log's speed.
    """
    name = controller or ("highway_pd" if speed_m_s > FAST_M_S else "practical_pd")
    middle = _nominal(found, found.x, speed_m_s)
    model = {"kind": "vehicle", **middle._asdict()}
    settings = load_settings(
        ControllerSettings,
        read_preset(PRESETS, name),
        shared=SharedTable("the identified vehicle", {"nominal_model": model}),
    )
    margin_s = _margin_s(settings, middle)
    drawn = _draws(found)
    margins_s = np.empty(DRAWS)
    for number, x in enumerate(drawn):
        try:
            progress("delays", number + 1, DRAWS)
        except Stopped:
            return None
        margins_s[number] = _margin_s(settings, _nominal(found, x, speed_m_s))
    with np.errstate(invalid="ignore"):  # Where a coordinate, or the margin, is the same in all.
        shares = np.nan_to_num(np.corrcoef(drawn.T, margins_s)[-1, :-1] ** 2)
    most = int(np.argmax(shares))
    # Of 40, the second and the last but one lie near the ends of 95 %.
    low_s, high_s = np.sort(margins_s)[[1, -2]]
    ends = float(min(low_s, margin_s)), float(max(high_s, margin_s))
    narrows = user_name(found.problem, found.problem.coordinates[most].name)
    return DelayMargin(name, margin_s, *ends, narrows, float(shares[most]))


def _draws(found: Fit) -> FloatArray:
    """Return drawn coordinates, shape (DRAWS, p), within their limits."""
    widened = found.covariance * (found.critical / 1.96) ** 2
    rng = np.random.default_rng(_SEED)
    drawn = rng.multivariate_normal(found.x, widened, DRAWS, check_valid="ignore", method="eigh")
    low = [one.low for one in found.problem.coordinates]
    high = [one.high for one in found.problem.coordinates]
    return np.clip(drawn, low, high)


def _nominal(found: Fit, x: FloatArray, speed_m_s: float) -> NominalVehicle:
    vehicle, _ = car_tables(found.problem.values(x), found.problem.known)
    values = vehicle.model_dump(include=set(NominalVehicle._fields))
    return NominalVehicle(**{**values, "speed_m_s": speed_m_s})


def _margin_s(settings: ControllerSettings, vehicle: NominalVehicle) -> float:
    return least_margin_ns([loop_around(settings, vehicle, {})]) / NS_PER_S
