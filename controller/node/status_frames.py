"""The frames that report the controller's state, for monitoring, every STATUS_PERIOD_NS.

CONTROLLER_SAFETY alone leaves in between as well: ``controller.node.safety_alarms`` decides when.
"""

from ...dbc.messages import (
    ControllerStatus,
    DelayStatus,
    LawNumber,
    Mode,
    ModelStatus,
    Sender,
    ShownMassState,
    SpeedRequest,
    limits,
)
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ..law_interface import LawOutput, VehicleBelief

STATUS_PERIOD_NS = NS_PER_S // 10
"""Cycle of CONTROLLER_STATUS, CONTROLLER_SAFETY and DELAY_STATUS."""
MODEL_PERIODS = 10
"""MODEL_STATUS comes with every tenth of these."""
SPEED_M_S_MAX = limits(SpeedRequest)["speed_max_m_s"].maximum
"""A request for this speed ends all others."""
_LIMITS, _MODEL_LIMITS = limits(ControllerStatus), limits(ModelStatus)
_DISTURBANCE, _NETWORK = _LIMITS["disturbance_rad"], _LIMITS["network_disturbance_rad"]
_SKIPPED_COUNTERS = int(_LIMITS["skipped_ticks"].maximum) + 1


def controller_status(
    mode: Mode, law: LawNumber, disturbance_rad: float, network_rad: float, skipped: int
) -> ControllerStatus:
    """Return the status; an estimate is clamped to the range of its signal."""
    return ControllerStatus(
        mode=mode,
        law=law,
        disturbance_rad=clamped(disturbance_rad, _DISTURBANCE.minimum, _DISTURBANCE.maximum),
        network_disturbance_rad=clamped(network_rad, _NETWORK.minimum, _NETWORK.maximum),
        skipped_ticks=skipped % _SKIPPED_COUNTERS,
    )


def clamped(value: float, minimum: float, maximum: float) -> float:
    """Return a finite ``value`` clamped to a signal's range."""
    return min(max(value, minimum), maximum)


class StatusFrames:
    """Makes CONTROLLER_STATUS, DELAY_STATUS, MODEL_STATUS and SPEED_REQUEST."""

    def __init__(self, law: LawNumber) -> None:
        self._law = law
        self._statuses, self._delays = Sender(ControllerStatus), Sender(DelayStatus)
        self._models = Sender(ModelStatus)
        self._speeds = Sender(SpeedRequest)
        self._asked_m_s = SPEED_M_S_MAX

    def status(self, mode: Mode, output: LawOutput, skipped: int) -> Frame:
        """Return the status."""
        estimates = output.disturbance_rad, output.network_disturbance_rad
        return self._statuses.frame(controller_status(mode, self._law, *estimates, skipped))

    def delay(self, status: DelayStatus) -> Frame:
        """Return the frame of the delay."""
        return self._delays.frame(status)

    def speed(self, asked_m_s: float | None) -> list[Frame]:
        """Return the request for a speed: none before the first that is below all speeds."""
        before_m_s, asked_m_s = self._asked_m_s, min(asked_m_s or SPEED_M_S_MAX, SPEED_M_S_MAX)
        self._asked_m_s = asked_m_s
        if before_m_s == asked_m_s == SPEED_M_S_MAX:
            return []
        return [self._speeds.frame(SpeedRequest(speed_max_m_s=asked_m_s))]

    def model(self, belief: VehicleBelief, shown_mass_kg: float | None) -> Frame:
        """Return the frame of the vehicle as the law takes it, and as its yaw rate shows it."""
        state = ShownMassState.UNKNOWN if shown_mass_kg is None else ShownMassState.KNOWN
        status = ModelStatus(
            steering_lag_s=clamped(belief.steering_lag_s, *_MODEL_LIMITS["steering_lag_s"]),
            virtual_mass_kg=clamped(belief.virtual_mass_kg, *_MODEL_LIMITS["virtual_mass_kg"]),
            shown_mass_kg=clamped(shown_mass_kg or 0.0, *_MODEL_LIMITS["shown_mass_kg"]),
            shown_mass_state=state,
        )
        return self._models.frame(status)
