"""Settings of the controller: the tables of its law, its limits, its supervision and its timing.

Each table stands with its subject; here they become one file of settings.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from pydantic import model_validator

from ..dbc.codec.counter_rule import CounterRule
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.node.overruns import OverrunSettings
from ..runtime.settings import SharedTable, load_settings, read_preset, read_table
from .age_limits import AgeLimits, SupervisionSettings, age_limits_of, resync_ns_of
from .laws.law_from_settings import design_law
from .laws.settings import LawSettings
from .limits.designed_ranges import DesignedRanges, designed_ranges_of
from .limits.steer_limits import LimitSettings, SteerLimits, steer_limits_of
from .who_steers import HandWheelSettings

PRESETS = "steer_by_wire.controller.presets"
"""The package with the presets that are shipped."""


class ControllerSettings(LawSettings):
    """All that the program reads from its settings file."""

    limits: LimitSettings = LimitSettings()
    supervision: SupervisionSettings = SupervisionSettings()
    hand_wheel: HandWheelSettings | None = None
    """Answer HAND_WHEEL_STATE and say who steers; if omitted, the law does."""
    overruns: OverrunSettings = OverrunSettings()
    """Limits beyond which the controller counts as too slow, stops steering, and ends."""

    @model_validator(mode="after")
    def _refuse_late_reactions(self) -> Self:
        self.supervision.refuse_late_reactions(self.period_ns)
        return self

    @property
    def period_ns(self) -> int:
        """The control period [ns], the whole number nearest to what ``rate_hz`` asks for."""
        return round(NS_PER_S / self.rate_hz)

    @property
    def law_that_reads_the_vehicle(self) -> str:
        """The law's name if it needs more than the lateral error; else empty.

        Without curvature and speed, the set point of the followed point stays 0.
        """
        alone = self.model_copy(update={"followed_point": "preview"})
        reads_more = self.law_record.looks_back or design_law(alone).looks_back
        return self.law if reads_more else ""

    @property
    def steer_limits(self) -> SteerLimits:
        """The bounds of one command."""
        return steer_limits_of(self.limits, self.period_ns)

    @property
    def designed_ranges(self) -> DesignedRanges:
        """The speeds and the delay that the settings were designed for."""
        return designed_ranges_of(self.validity, self.period_ns / NS_PER_S)

    @property
    def demand_ranges(self) -> DesignedRanges:
        """The speeds at which the law may ask for all of its steer."""
        scheduled = None if self.law_record.schedules_demand else self.validity
        return designed_ranges_of(scheduled, self.period_ns / NS_PER_S)

    @property
    def age_limits(self) -> AgeLimits:
        """The age limit of each message."""
        return age_limits_of(self.supervision, self.period_ns)

    @property
    def counters(self) -> CounterRule:
        """Which counters of the measurements are accepted."""
        table = self.supervision
        lead_ns, silence_ns = table.counter_lead_ms * NS_PER_MS, resync_ns_of(table, self.period_ns)
        return CounterRule(round(lead_ns), table.recovery_frames, silence_ns)


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
    return SharedTable(str(file), {"nominal_model": nominal_vehicle(file)})


def nominal_vehicle(file: Path) -> dict[str, Any]:
    """Return [vehicle] of a file, as a nominal model; raises SettingsError."""
    table = read_table(file, "vehicle")
    model = {key: value for key, value in table.items() if not key.startswith("initial_")}
    return {"kind": "vehicle", **model}


def on_bus(settings: ControllerSettings, *, takes_fd: bool) -> ControllerSettings:
    """Return the settings for a bus: without CAN FD, a law that plans sends single commands."""
    single = settings.law_record.single_commands
    return settings if takes_fd or not single else settings.model_copy(update={"law": single})
