"""Settings of the controller: its law, the limits on its commands, the supervision of its inputs.

Times a user sets are in milliseconds; ``period_ns``, ``supervision_of`` and ``limits_of`` convert
them for the node and the step functions.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, PositiveFloat, Tag, model_validator

from ..dbc.codec.protection import SequenceRule
from ..dbc.messages import SteeringCommand
from ..dbc.messages import limits as signal_limits
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.node.overruns import OverrunSettings
from ..runtime.settings import (
    NUMBER_OR_WORD,
    OffWord,
    Settings,
    SharedTable,
    load_settings,
    read_preset,
    read_table,
)
from .delay_estimation.delay_settings import DelayEstimationSettings
from .history.freshness import NO_LIMIT_NS, AgeLimits
from .interface.limits import SteerLimits
from .laws.settings import LawSettings
from .node.modes import Supervision

PRESETS = "steer_by_wire.controller.presets"
"""The package with the presets that are shipped."""
REPORTING_MS = 5.0
"""Part of the fault tolerant time for reporting on the bus: a late tick, and the wire."""
_TIMEOUTS = ("measurement_timeout_ms", "steering_status_timeout_ms", "vehicle_state_timeout_ms")
"""Keys of [supervision], in the order of ``AgeLimits``."""

AgeMs = Annotated[float, Field(ge=1.0, le=10_000.0)]
AgeMsOrOff = Annotated[Annotated[AgeMs, Tag("number")] | OffWord, NUMBER_OR_WORD]


class LimitSettings(Settings):
    """Limits on every command, under any law.

    ``steer_rad_max``         to either side, within the range of the command's signal [rad]
    ``steer_rate_rad_s_max``  [rad/s]
    """

    steer_rad_max: Annotated[
        float, Field(gt=0.0, le=signal_limits(SteeringCommand)["steer_rad"].maximum)
    ] = 0.6
    steer_rate_rad_s_max: Annotated[float, Field(gt=0.0, le=1000.0)] = 2.0


class SupervisionSettings(Settings):
    """What happens when messages stop, and when they are trusted again.

    ``fault_tolerant_time_ms``  after a message stops, the controller must react and report it on
                                the bus within this time (fault tolerant time interval, ISO 26262)
    ``measurement_timeout_ms``  a LATERAL_ERROR older than this is not used to steer: HOLDING. If
                                omitted: the fault tolerant time, less a period for the tick and
                                5 ms for the frame that reports it. A step in the network's latency
                                also is a gap in what arrives
    ``steering_status_timeout_ms``  without a STEERING_STATUS for longer, the delay counts as
                                unknown. If omitted: as above
    ``vehicle_state_timeout_ms``  without a VEHICLE_STATE for longer, its curvature and yaw rate
                                count as out of date and the delay as unknown. If omitted: as
                                above. "off": no limit, for a plant that sends it rarely
    ``hold_ms``                 how long the last command is held then
    ``ramp_rad_s``              how fast it is then ramped to zero; also how fast the difference
                                between the held command and the law's fades out on recovery
    ``recovery_frames``         good measurements in a row that end the hold or the ramp
    ``counter_lead_ms``         how much earlier than the time since the newest measurement explains
                                a newer one may come: the spread of the network's latency
    """

    fault_tolerant_time_ms: Annotated[float, Field(ge=1.0, le=60_000.0)] = 150.0
    measurement_timeout_ms: AgeMs | None = None
    steering_status_timeout_ms: AgeMs | None = None
    vehicle_state_timeout_ms: AgeMsOrOff | None = None
    hold_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 500.0
    ramp_rad_s: PositiveFloat = 0.2
    recovery_frames: Annotated[int, Field(ge=1, le=100)] = 5
    counter_lead_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 300.0


class ControllerSettings(LawSettings):
    """All that the program reads from its settings file."""

    limits: LimitSettings = LimitSettings()
    supervision: SupervisionSettings = SupervisionSettings()
    delay_estimation: DelayEstimationSettings = DelayEstimationSettings()
    overruns: OverrunSettings = OverrunSettings()
    """Limits beyond which the controller counts as too slow, stops steering, and ends."""

    @model_validator(mode="after")
    def _refuse_a_reaction_that_comes_too_late(self) -> Self:
        table, period_ms = self.supervision, self.period_ns / NS_PER_MS
        for key in _TIMEOUTS:
            limit_ms = getattr(table, key)
            if isinstance(limit_ms, str):
                continue
            # A tick may come a whole period after the timeout.
            reaction_ms = period_ms + REPORTING_MS
            if (limit_ms or 1.0) + reaction_ms > table.fault_tolerant_time_ms:
                timeout = (
                    "a measurement timeout of 1 ms"
                    if limit_ms is None
                    else f"supervision.{key} = {limit_ms:g}"
                )
                raise ValueError(
                    f"{timeout}, a period of {period_ms:g} ms and {REPORTING_MS:g} ms to report it"
                    " are more than supervision.fault_tolerant_time_ms ="
                    f" {table.fault_tolerant_time_ms:g}"
                )
        return self

    @property
    def period_ns(self) -> int:
        """The control period [ns], the whole number nearest to what ``rate_hz`` asks for."""
        return round(NS_PER_S / self.rate_hz)


def sparse_measurements(settings: ControllerSettings, sensor_period_s: float) -> str:
    """Return a warning where the law differentiates measurements rarer than its ticks, else "".

    An unfiltered derivative then acts in the first tick after each measurement only. The paper's
    presets are such laws at 1 kHz.
    """
    period_s, pd = settings.period_ns / NS_PER_S, settings.pd
    is_ideal = pd is not None and pd.derivative_filter_rad_s is None and pd.derivative != "kalman"
    if not is_ideal or sensor_period_s < 1.5 * period_s:
        return ""
    return (
        f"warning: measurements about every {1e3 * sensor_period_s:.3g} ms for a control period of"
        f" {1e3 * period_s:.3g} ms make this another law, as its derivative has no filter; set the"
        f" plant's sensor_period_ms = {1e3 * period_s:.3g}"
    )


def controller_preset(name: str, overrides: Sequence[str] = ()) -> ControllerSettings:
    """Return the settings of a preset, with ``overrides`` as for ``load_settings`` on top.

    Raises SettingsError.
    """
    return load_settings(ControllerSettings, read_preset(PRESETS, name), overrides=overrides)


def shared_vehicle(file: Path | None) -> SharedTable | None:
    """Return [vehicle] of a file that the plant reads too, as [nominal_model].

    Raises SettingsError.
    """
    if file is None:
        return None
    table = read_table(file, "vehicle")
    return SharedTable(str(file), {"nominal_model": {"kind": "vehicle", **table}})


def on_bus(settings: ControllerSettings, *, takes_fd: bool) -> ControllerSettings:
    """Return the settings for a bus: without CAN FD, a law that plans sends single commands."""
    single = settings.law_record.single_commands
    return settings if takes_fd or not single else settings.model_copy(update={"law": single})


def supervision_of(settings: ControllerSettings) -> Supervision:
    """Return the parameters of the mode table."""
    table = settings.supervision
    return Supervision(
        measurement_timeout_ns=age_limits_of(settings).lateral_error_ns,
        hold_ns=round(table.hold_ms * NS_PER_MS),
        recovery_frames=table.recovery_frames,
    )


def age_limits_of(settings: ControllerSettings) -> AgeLimits:
    """Return the age limit of each message; omitted ones are derived from the FTTI."""
    table = settings.supervision
    reaction_ms = settings.period_ns / NS_PER_MS + REPORTING_MS

    def limit_ns(limit_ms: float | str | None) -> int:
        if isinstance(limit_ms, str):
            return NO_LIMIT_NS
        if limit_ms is None:
            limit_ms = table.fault_tolerant_time_ms - reaction_ms
        return round(limit_ms * NS_PER_MS)

    return AgeLimits(*(limit_ns(getattr(table, key)) for key in _TIMEOUTS))


def counters_of(settings: ControllerSettings) -> SequenceRule:
    """Return which counters of the measurements are believed."""
    table = settings.supervision
    return SequenceRule(
        round(table.counter_lead_ms * NS_PER_MS), table.recovery_frames, resync_ns_of(settings)
    )


def resync_ns_of(settings: ControllerSettings) -> int:
    """Return the silence of a message after which a restart of its sender is accepted [ns].

    It is longer than any age limit plus the tick that acts on it. A stream of measurements that
    does not continue the previous one is therefore used only after a hold and the run that ends it.
    """
    limits = (limit_ns for limit_ns in age_limits_of(settings) if limit_ns != NO_LIMIT_NS)
    return max(limits) + settings.period_ns + 1


def limits_of(settings: ControllerSettings) -> SteerLimits:
    """Return the bounds of one command."""
    step_rad_max = settings.limits.steer_rate_rad_s_max * settings.period_ns / NS_PER_S
    return SteerLimits(settings.limits.steer_rad_max, step_rad_max)
