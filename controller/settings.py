"""Settings of the controller: its law, the limits on its commands, and the care for its inputs.

Times a user sets are in milliseconds; ``period_ns``, ``supervision_of`` and ``limits_of`` give them
as the node and the step functions want them.
"""

from typing import Annotated, Self

from pydantic import Field, PositiveFloat, model_validator

from controller.delay_settings import DelayEstimationSettings
from controller.law_settings import LawSettings
from controller.limits import SteerLimits
from controller.modes import Supervision
from dbc.messages import SteeringCommand
from dbc.messages import limits as signal_limits
from runtime.node import NS_PER_MS, NS_PER_S
from runtime.overruns import OverrunSettings
from runtime.settings import Settings

TELLING_MS = 5.0
"""Of the fault tolerant time, for the frame that tells the bus: a late tick, and the wire."""


class LimitSettings(Settings):
    """Limits on every command, whatever the law says.

    ``steer_rad_max``         to either side; never beyond what the command's signal can carry [rad]
    ``steer_rate_rad_s_max``  [rad/s]
    """

    steer_rad_max: Annotated[
        float, Field(gt=0.0, le=signal_limits(SteeringCommand)["steer_rad"].maximum)
    ] = 0.6
    steer_rate_rad_s_max: Annotated[float, Field(gt=0.0, le=1000.0)] = 2.0


class SupervisionSettings(Settings):
    """What happens when measurements stop, and when they are believed again.

    ``fault_tolerant_time_ms``  within this after measurements stop, HOLDING has to be entered and
                                told on the bus (the fault tolerant time interval of ISO 26262)
    ``measurement_timeout_ms``  a measurement older than this is not steered by; left out: as old
                                as the fault tolerant time allows, with a period for the tick and
                                5 ms for the frame that tells it. A step in the network's latency is
                                a gap in what arrives, too
    ``hold_ms``                 how long the last command is held then
    ``ramp_rad_s``              how fast it is then ramped to zero; also how fast the difference
                                between the held command and the law's fades out on recovery
    ``recovery_frames``         good measurements in a row that end the hold or the ramp
    ``max_counter_jump``        frames that may be lost in a row, plus one, before a counter is
                                no longer believed to go on
    """

    fault_tolerant_time_ms: Annotated[float, Field(ge=1.0, le=60_000.0)] = 150.0
    measurement_timeout_ms: Annotated[float, Field(ge=1.0, le=10_000.0)] | None = None
    hold_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 500.0
    ramp_rad_s: PositiveFloat = 0.2
    recovery_frames: Annotated[int, Field(ge=1, le=100)] = 5
    max_counter_jump: Annotated[int, Field(ge=1, le=127)] = 100


class ControllerSettings(LawSettings):
    """All that the program reads from its settings file."""

    limits: LimitSettings = LimitSettings()
    supervision: SupervisionSettings = SupervisionSettings()
    delay_estimation: DelayEstimationSettings = DelayEstimationSettings()
    overruns: OverrunSettings = OverrunSettings()
    """Beyond these the controller takes itself for too slow, stops steering, and ends."""

    @model_validator(mode="after")
    def _refuse_a_reaction_that_comes_too_late(self) -> Self:
        table, period_ms = self.supervision, self.period_ns / NS_PER_MS
        # A tick may come a whole period after the timeout.
        reaction_ms = period_ms + TELLING_MS
        if (table.measurement_timeout_ms or 1.0) + reaction_ms > table.fault_tolerant_time_ms:
            timeout = (
                "a measurement timeout of 1 ms"
                if table.measurement_timeout_ms is None
                else f"supervision.measurement_timeout_ms = {table.measurement_timeout_ms:g}"
            )
            raise ValueError(
                f"{timeout}, a period of {period_ms:g} ms and {TELLING_MS:g} ms to tell it are more"
                f" than supervision.fault_tolerant_time_ms = {table.fault_tolerant_time_ms:g}"
            )
        return self

    @property
    def period_ns(self) -> int:
        """The control period [ns], the whole number nearest to what ``rate_hz`` asks for."""
        return round(NS_PER_S / self.rate_hz)


def supervision_of(settings: ControllerSettings) -> Supervision:
    """Return the parameters of the mode table."""
    table = settings.supervision
    timeout_ms = table.measurement_timeout_ms
    if timeout_ms is None:
        reaction_ms = settings.period_ns / NS_PER_MS + TELLING_MS
        timeout_ms = table.fault_tolerant_time_ms - reaction_ms
    return Supervision(
        measurement_timeout_ns=round(timeout_ms * NS_PER_MS),
        hold_ns=round(table.hold_ms * NS_PER_MS),
        recovery_frames=table.recovery_frames,
    )


def limits_of(settings: ControllerSettings) -> SteerLimits:
    """Return the bounds of one command."""
    step_rad_max = settings.limits.steer_rate_rad_s_max * settings.period_ns / NS_PER_S
    return SteerLimits(settings.limits.steer_rad_max, step_rad_max)
