"""Runner of the law: keeps its parameters and state, and fades its commands in.

On recovery the law starts again, at rest at the present measurement. Its first command differs from
the held one. The difference is added to its commands and fades out at the ramp rate, so that the
first command equals the last one held. As always, the law's input is the command that acts.
"""

from math import isfinite
from typing import Any

from ...dbc.messages import Mode
from ...runtime.fast_named_tuple import new_record
from ...runtime.node import NS_PER_S
from ..history.history import BusHistory
from ..law_interface import (
    NO_HISTORY,
    NO_LOOP_DELAY,
    NO_VEHICLE,
    LawInput,
    LawOutput,
    VehicleBelief,
    VehicleReading,
)
from ..laws.law_from_settings import design_law
from ..limits.designed_ranges import share_of_demand
from ..limits.fades_and_ramps import difference_step
from ..settings import ControllerSettings

FAILURES_MAX = 1
"""Restarts of a law after an output that is not finite; one more failure stops it for good."""


class LawRunner:
    """Holds the law, its state and the history of the bus.

    ``bus_history``  measurements, by which a law that looks back knows their rate; None for others
    ``read_history``  that one with commands and echoes, for a law that reads them; None for others
    ``output``    newest finite output
    ``acting``    index of the value of the newest plan that acts first; -1 for no plan
    ``failures``  how often its output was not finite
    ``is_distrusted``  whether it has failed again after its restart
    ``ramp_step_rad``  largest step per period of a fade
    """

    def __init__(self, settings: ControllerSettings) -> None:
        self.design = design_law(settings)
        self.bus_history = (
            BusHistory(
                settings.loop_delay, settings.age_limits, keeps_plans=self.design.plan is not None
            )
            if self.design.looks_back
            else None
        )
        self.read_history = self.bus_history if self.design.reads_history else None
        self._history = NO_HISTORY if self.read_history is None else self.read_history.history
        self.output = LawOutput(0.0, 0.0, 0.0, 0.0)
        self.failures = 0
        self.acting = -1
        self.is_distrusted = False
        self._params, self._speed_m_s = self.design.params, NO_VEHICLE.speed_m_s
        self._ranges = settings.demand_ranges
        self._share = 1.0
        self._state: Any = None
        self._fade_rad = 0.0
        self._continues_hold = False  # until the next output
        self.ramp_step_rad = settings.supervision.ramp_rad_s * settings.period_ns / NS_PER_S

    @property
    def failure(self) -> str:
        """Why the law is distrusted; empty while it is not."""
        if not self.is_distrusted:
            return ""
        text = "the law's output was again not finite after a restart of the law"
        mistake = self.design.mistake()
        return f"{text}: {mistake}" if mistake else text

    @property
    def belief(self) -> VehicleBelief | None:
        """The model that the law steers by; None before its start, and for a law without one."""
        believes = self.design.believes
        return None if believes is None or self._state is None else believes(self._state)

    @property
    def asked_speed_m_s(self) -> float | None:
        """The speed that the law asks not to exceed [m/s]; None if it never asks, or not yet."""
        asks_speed = self.design.asks_speed
        return None if asks_speed is None or self._state is None else asks_speed(self._state)

    def on_speed(self, speed_m_s: float) -> None:
        """Set the law's parameters for a speed, and the share of its steer."""
        if speed_m_s == self._speed_m_s:
            return
        self._speed_m_s = speed_m_s
        self._share = share_of_demand(self._ranges, speed_m_s)
        if self.design.params_at is not None:
            self._params = self.design.params_at(speed_m_s)

    def start(self, before: Mode, lateral_error_m: float) -> None:
        """Prepare for ACTIVE after another mode: at rest at the newest measurement.

        Some laws continue in part after a hold.
        """
        if before is not Mode.HOLDING:
            self._state = None
        recovered = self.design.recovered_state
        if recovered is None or self._state is None:
            self._state = self.design.initial_state(lateral_error_m)
        else:
            self._state = recovered(self._state, lateral_error_m)
        # Before the first command there is no held command to continue from.
        self._fade_rad, self._continues_hold = 0.0, before is not Mode.WAITING

    def run(
        self, read: tuple[float, float, VehicleReading], sent_rad: float, period: int, now_ns: int
    ) -> float | None:
        """Advance by one period; returns the command [rad], None if it is not finite.

        ``read``  as of ``Received.read_by_law``
        """
        bus_history, design = self.read_history, self.design
        loop_delay = (
            NO_LOOP_DELAY if bus_history is None else bus_history.loop_delay(period, now_ns)
        )
        error_m, acting_rad, vehicle = read
        given = error_m, acting_rad, vehicle, loop_delay, self._history
        observed = new_record(LawInput, given)
        state, output = design.step(self._params, self._state, observed)
        steer_rad = self._share * output.steer_rad
        self.acting = -1
        if isfinite(steer_rad):
            self._state, self.output = state, output
            if self._continues_hold or self._fade_rad != 0.0:
                self._fade_rad = difference_step(
                    self.ramp_step_rad, self._fade_rad, sent_rad, steer_rad, self._continues_hold
                )
                self._continues_hold = False
            if design.plan is not None and self._fade_rad == 0.0:
                self.acting = design.plan(self._params, state, observed)
            command_rad = steer_rad + self._fade_rad
            if isfinite(command_rad):
                return command_rad
        self.failures += 1
        self.is_distrusted = self.failures > FAILURES_MAX
        self._state = None  # nothing that a recovery could continue from
        return None
