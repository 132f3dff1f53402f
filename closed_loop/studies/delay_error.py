"""How far the delay that the controller reports (DELAY_STATUS) is from the true one.

The truth is known only to whoever sees both ends of the network:

    constant latencies   down + up, as in the settings of the plant
    varying latencies    by the frames that came through: the mean time from sending a command to
                         the sample at which it acts, less half a control period, and the mean over
                         time of the latency of the VEHICLE_STATE in use, since the estimate watches
                         that. Sent half as often as a STEERING_STATUS, it is overtaken less.
"""

from math import nan
from typing import NamedTuple

import numpy as np

from ...controller.settings import ControllerSettings
from ...dbc import messages
from ...dbc.codec.protection import COUNTERS
from ...dbc.dialect.listening import Listening
from ...plant_emulator.network.latency_distributions import Distribution
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S


class DelayErrors(NamedTuple):
    """Figures of the reports of one run; NaN where there is none.

    ``estimate_share``        of the reports, those with an estimate
    ``estimate_error_s``      median of the errors
    ``estimate_error_max_s``  the largest magnitude
    ``echo_error_s``          mean error of the delay measured by the echo
    """

    estimate_share: float
    estimate_error_s: float
    estimate_error_max_s: float
    echo_error_s: float


class DelayListener:
    """Receives all frames of a run that starts at 0.

    ``listening``  understands the bus; that of a car names no command

    ``sent_rad``  the commands
    """

    def __init__(
        self, plant: PlantSettings, controller: ControllerSettings, listening: Listening
    ) -> None:
        self._listening = listening
        self._sample_ns = plant.sensor_period_ns
        self._state_samples = samples_per_vehicle_state(plant.sensor_period_ns)
        self._half_period_ns = 0.5 * controller.period_ns
        lines = plant.latency.downlink, plant.latency.uplink
        is_constant = all(
            line.model is Distribution.CONSTANT and not line.has_trace and not line.schedule
            for line in lines
        )
        self._configured_s = sum(line.mean_s for line in lines) if is_constant else None
        self._reported: list[tuple[float, float]] = []
        self._sent_ns: dict[int, int] = {}
        self.sent_rad: list[float] = []
        self._down_ns: list[int] = []
        self._state_ns = self._state_up_ns = 0
        self._up_sum_ns = self._up_time_ns = 0
        self._status_number = self._state_number = -1

    def on_wire(self, time_ns: int, _sender: int, frame: Frame) -> None:
        """Take a frame."""
        for ours in self._listening.hear(frame, time_ns).ours:
            self._on_ours(time_ns, ours)

    def _on_ours(self, time_ns: int, frame: Frame) -> None:
        decoded = messages.decode(frame)
        if not isinstance(decoded, messages.Decoded):
            return
        message, counter = decoded
        if isinstance(message, messages.DelayStatus):
            self._reported.append(_reported_s(message))
        elif isinstance(message, messages.SteeringCommand):
            self._sent_ns[message.command_counter] = time_ns
            self.sent_rad.append(message.steer_rad)
        elif isinstance(message, messages.SteeringStatus):
            self._status_number = _next(self._status_number, counter)
            sent_ns = self._sent_ns.get(message.applied_counter)
            if message.status and sent_ns is not None:
                self._down_ns.append(self._status_number * self._sample_ns - sent_ns)
        elif isinstance(message, messages.VehicleState):
            self._state_number = _next(self._state_number, counter)
            self._up_sum_ns += self._state_up_ns * (time_ns - self._state_ns)
            self._up_time_ns += time_ns - self._state_ns if self._state_ns else 0
            sampled_ns = self._state_number * self._state_samples * self._sample_ns
            self._state_ns, self._state_up_ns = time_ns, time_ns - sampled_ns

    @property
    def errors(self) -> DelayErrors:
        """The figures of the reports so far."""
        if not self._reported:
            return DelayErrors(nan, nan, nan, nan)
        echo_s, estimate_s = np.array(self._reported).T - self._truth_s()
        known_s, echo_s = estimate_s[np.isfinite(estimate_s)], echo_s[np.isfinite(echo_s)]
        return DelayErrors(
            len(known_s) / len(estimate_s),
            float(np.median(known_s)) if len(known_s) else nan,
            float(np.abs(known_s).max()) if len(known_s) else nan,
            float(echo_s.mean()) if len(echo_s) else nan,
        )

    def _truth_s(self) -> float:
        if self._configured_s is not None:
            return self._configured_s
        if not (self._down_ns and self._up_time_ns):
            return nan
        up_ns = self._up_sum_ns / self._up_time_ns
        return float(np.mean(self._down_ns) + up_ns - self._half_period_ns) / NS_PER_S


def _next(number: int, counter: int) -> int:
    """Return the first number after ``number`` whose E2E counter is ``counter``."""
    return number + 1 + (counter - number - 1) % COUNTERS


def _reported_s(message: messages.DelayStatus) -> tuple[float, float]:
    """Return echo and estimate [s], NaN for what is not known."""
    is_known = message.echo_state is messages.EchoState.KNOWN
    is_observable = message.estimate_state is messages.EstimateState.OBSERVABLE
    return (
        message.echo_delay_s if is_known else nan,
        message.estimated_delay_s if is_observable else nan,
    )
