"""The paper's own controllers beside the frontier: what they guarantee, without demands on them.

As published, and with what the paper does not have: a derivative filter, and a washout in the CDOB,
without which that drifts off the path.
"""

import math
from collections.abc import Iterator, Sequence

from ....controller.laws.law_from_settings import design_law
from ....controller.settings import controller_preset
from ....runtime.node import NS_PER_MS
from ..loop_figures import frequency_grid, loop_figures
from ..vehicle_file import VehicleFile
from .settings import FrontierSettings
from .sweep import Point, margins_ms
from .trials import worst_rms_m

PUBLISHED = "published"
FILTERED = "published gains, filter and washout"
LAWS = {"PD": "paper_pd", "PD + DOB": "paper_pd_dob", "PD + CDOB": "paper_pd_cdob",
        "PD + DDOB": "paper_pd_ddob"}  # fmt: skip
FILTER_RAD_S, WASHOUT_RAD_S = 30.0, 3.0
_POINTS = 1500


def published_points(asked: FrontierSettings, vehicle: VehicleFile) -> Iterator[Point]:
    """Yield a point for each law of the paper, first as published; its structure names both.

    ``delay_ms`` is the margin of the worst corner less the share that all others keep; 0, with an
    infinite error, where the loop drifts off whatever the delay.
    """
    filtered = f"pd.derivative_filter_rad_s={FILTER_RAD_S:g}"
    washout = f"cdob.washout_rad_s={WASHOUT_RAD_S:g}"
    for name, preset in LAWS.items():
        yield _point(asked, vehicle, f"{PUBLISHED}: {name}", preset, ())
    for name, preset in LAWS.items():
        overrides = (filtered, washout) if "CDOB" in name or "DDOB" in name else (filtered,)
        yield _point(asked, vehicle, f"{FILTERED}: {name}", preset, overrides)


def _point(
    asked: FrontierSettings,
    vehicle: VehicleFile,
    structure: str,
    preset: str,
    overrides: Sequence[str],
) -> Point:
    settings = controller_preset(preset, overrides)
    margin_ms, nominal_ms, lagged_ms = margins_ms(settings, vehicle, asked.trials.lag_s)
    delay_ms = margin_ms / (1.0 + asked.margin_share)
    rms_m = noise_rad_m = peak = math.inf
    if delay_ms:
        rms_m = worst_rms_m(asked, vehicle, settings, delay_ms)
        delays_ns = 0, round(delay_ms * NS_PER_MS)
        grid = frequency_grid(vehicle.models, delays_ns, settings.period_ns, _POINTS)
        figures = loop_figures(grid, design_law(settings))
        noise_rad_m = float(figures.noise_gain_rad_m.max())
        peak = float(figures.peak_sensitivity.max())
    q_kind = None if settings.dob is None else settings.dob.q_kind
    return Point(
        *(structure, delay_ms, rms_m, noise_rad_m, peak, margin_ms, nominal_ms, lagged_ms, 0, {}),
        q_kind,
    )
