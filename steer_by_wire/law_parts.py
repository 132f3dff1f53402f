"""Parts of the shipped laws for a law of one's own: PD, plans, the prediction of the vehicle.

``LAWS``       the shipped laws by name, whose step and design another law can use
``pd_*``       C(s) of the paper, a step on floats
``Schedule``   params that depend on the speed
``History``    what was sent and measured; ``plan_times`` and ``PLAN_VALUES`` fit a plan into it
the others     gains of the sampled vehicle, its estimate and its prediction over the loop's delay
"""

from .controller.filters.discretization import design_pd
from .controller.filters.pd_filter import PdParams, pd_at_rest, pd_step
from .controller.filters.sections import SectionState
from .controller.history.echo_delay import LoopDelayParams
from .controller.history.plan import VALUES as PLAN_VALUES
from .controller.law_interface import (
    NO_HISTORY,
    NO_LOOP_DELAY,
    History,
    LoopDelay,
    Schedule,
    last_command,
)
from .controller.laws import LAWS
from .controller.laws.law_from_settings import vehicle_of
from .controller.laws.packet import plan_times
from .controller.prediction.gains_over_speed import noise_covariances, sampled_vehicles
from .controller.prediction.measured_vehicle import measured_gains
from .controller.prediction.prediction import predict, steer_for
from .controller.prediction.vehicle_kalman_filter import (
    EstimatorState,
    VehicleGains,
    command_from,
    estimate_to,
    estimator_at_rest,
    step_on_path,
)

__all__ = [
    "LAWS",
    "NO_HISTORY",
    "NO_LOOP_DELAY",
    "PLAN_VALUES",
    "EstimatorState",
    "History",
    "LoopDelay",
    "LoopDelayParams",
    "PdParams",
    "Schedule",
    "SectionState",
    "VehicleGains",
    "command_from",
    "design_pd",
    "estimate_to",
    "estimator_at_rest",
    "last_command",
    "measured_gains",
    "noise_covariances",
    "pd_at_rest",
    "pd_step",
    "plan_times",
    "predict",
    "sampled_vehicles",
    "steer_for",
    "step_on_path",
    "vehicle_of",
]
