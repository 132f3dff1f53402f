"""Loops with a vehicle for which each stretch of stable delays is wide enough to show in runs.

``PLANT`` is this vehicle for the settings of the plant.
"""

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.controller.settings import ControllerSettings, controller_preset

PERIOD_NS = 10_000_000
_VALUES = ("front_cornering_stiffness_n_rad=195000", "preview_distance_m=1.912")
PLANT = tuple(f"vehicle.{value}" for value in _VALUES)
_MODEL = tuple(f"nominal_model.{value}" for value in _VALUES)
_PAPER_GAINS = ("pd.proportional_gain_rad_m=1.0596", "pd.derivative_gain_rad_s_m=0.939")
_WIDE_LIMITS = ("limits.steer_rad_max=1.3", "limits.steer_rate_rad_s_max=1000")
_CDOB = ("pd.derivative_filter_rad_s=20", "cdob.q_cutoff_rad_s=50", "cdob.washout_rad_s=3")
_INTEGRATOR = TransferFunction(-1, (Factor(0.0, 0.0, 1.0),), ())


def _law(preset: str, *overrides: str) -> ControllerSettings:
    preview = "followed_point=preview"  # a set point is outside the loop
    return controller_preset(preset, [*_PAPER_GAINS, *_MODEL, *_WIDE_LIMITS, preview, *overrides])


PD = _law("practical_pd", "pd.derivative_filter_rad_s=20")
PD_DOB = _law("practical_pd_dob", "pd.derivative_filter_rad_s=5", "dob.q_cutoff_rad_s=2")
PD_CDOB = _law("practical_pd_cdob", *_CDOB)
PD_DDOB = _law("practical_pd_ddob", *_CDOB, "dob.q_cutoff_rad_s=2")


def loop_of(chosen: ControllerSettings) -> SampledLoop:
    assert chosen.model is not None
    return SampledLoop(design_law(chosen), chosen.model, chosen.period_ns)


def proportional_loop(gain: float) -> SampledLoop:
    """y[k+1] = y[k] - gain ((1 - e) y[k] + e y[k-1]) at 100 Hz, with a delay of e periods."""
    pd = {"proportional_gain_rad_m": 100.0 * gain, "derivative_gain_rad_s_m": 0.0}
    design = design_law(LawSettings.model_validate({"law": "pd", "pd": pd}))
    return SampledLoop(design, _INTEGRATOR, PERIOD_NS)
