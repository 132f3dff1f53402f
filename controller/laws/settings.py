"""Settings of the control laws: which law runs, and the tables it is designed from.

Values from which no filter can be built are refused here, naming the key.
"""

from functools import cache
from math import pi
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar

from pydantic import BeforeValidator, Field, WithJsonSchema, create_model, model_validator
from pydantic_core import PydanticKnownError

from ...dbc.messages import CYCLE_TIMES_MS, LawNumber, VehicleState
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import Settings
from ...runtime.settings.plugin import (
    PLUGIN_TABLE,
    TABLE_SCHEMA,
    PluginTable,
    find_part,
    plugin_table,
)
from ..filters.settings import (
    CdobSettings,
    DobSettings,
    NominalModelSettings,
    PdSettings,
    VehicleModelSettings,
)
from ..filters.transfer_function import TransferFunction
from ..history.echo_delay import LinkSettings, LoopDelayParams
from ..law_interface import Law
from ..limits.designed_ranges import ValiditySettings
from ..prediction.gains_over_speed import EstimatorSettings
from . import LAWS
from .feed_forward import FeedForwardSettings
from .set_point import FollowedPoint

_Table = TypeVar("_Table", bound=Settings)


def find_law(name: str) -> Law:
    """Return the law with this name, ours or one of another package; raises ValueError."""
    return LAWS[name] if name in LAWS else _as_custom(find_part(name, Law, "law"))


@cache
def _as_custom(law: Law) -> Law:
    return law._replace(number=LawNumber.CUSTOM)


def _known_law(name: Any) -> Any:
    if not isinstance(name, str) or (name not in LAWS and ":" not in name):
        raise PydanticKnownError("enum", {"expected": ", ".join(LAWS)})
    find_law(name)
    return name


LawName = Annotated[
    str, BeforeValidator(_known_law), WithJsonSchema({"enum": list(LAWS), "type": "string"})
]


class _SharedTables(Settings):
    """Settings that all laws share."""

    law: LawName
    rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 100.0
    pd: PdSettings | None = None
    dob: DobSettings | None = None
    cdob: CdobSettings | None = None


if TYPE_CHECKING:

    class _TablesOfLaws(_SharedTables):
        pass

else:  # a field for each law that has a table, named after the law
    _TablesOfLaws = create_model(
        "_TablesOfLaws",
        __base__=_SharedTables,
        **{
            name: (law.settings | None, None)
            for name, law in LAWS.items()
            if law.settings is not None
        },
    )


class LawSettings(_TablesOfLaws):
    """Settings of a law; tables that it does not use may be omitted."""

    own_law: Annotated[
        PluginTable, plugin_table(find_law, "law", lambda name: name not in LAWS), TABLE_SCHEMA
    ] = PLUGIN_TABLE
    """Table of a law from another package; the law's record contains its model."""
    feed_forward: FeedForwardSettings | None = None
    followed_point: FollowedPoint = "preview"
    """The preview point, whose error is measured, as in the paper; or another point's."""
    estimator: EstimatorSettings = EstimatorSettings()
    link: LinkSettings = LinkSettings()
    nominal_model: NominalModelSettings | None = None
    validity: ValiditySettings | None = None
    """What the preset was designed for; None: unknown."""

    @property
    def law_record(self) -> Law:
        """Return the law itself."""
        return find_law(self.law)

    @property
    def period_s(self) -> float:
        """The control period [s]."""
        return 1.0 / self.rate_hz

    @property
    def loop_delay(self) -> LoopDelayParams:
        """The parameters of the measurement of the delay."""
        sensor_period_s, yaw_rate_samples = self.link.sensor_period_s, 0
        if self.estimator.yaw_rate_sensor_noise_rad_s is not None:
            yaw_rate_ms = CYCLE_TIMES_MS[VehicleState]
            yaw_rate_samples = max(int(yaw_rate_ms / self.link.sensor_period_ms), 1)
        return LoopDelayParams(
            round(NS_PER_S / self.rate_hz),
            round(self.link.sensor_period_ms * NS_PER_MS),
            max(1.0, self.link.delay_averaging_s / sensor_period_s),
            round(self.estimator.actuator_dead_time_s / sensor_period_s),
            yaw_rate_samples,
        )

    @property
    def model(self) -> TransferFunction | None:
        """Return G_n, or None where there is no [nominal_model]."""
        return None if self.nominal_model is None else self.nominal_model.model

    @property
    def _table(self) -> str:
        """The name of the law's own table."""
        return self.law if self.law in LAWS else "own_law"

    def table_of(self, kind: type[_Table]) -> _Table:
        """Return the table of this kind: the law's own, or one that it needs."""
        for name in (self._table, *self.law_record.needs):
            if isinstance(table := getattr(self, name, None), kind):
                return table
        raise ValueError(f"law = {self.law!r} has no table of {kind.__name__}")

    @model_validator(mode="after")
    def _refuse_missing_tables(self) -> Self:
        law = self.law_record
        for table in (*([] if law.settings is None else [self._table]), *law.needs):
            if getattr(self, table, None) is None:
                raise ValueError(f"law = {self.law!r} needs the table [{table}]")
        if law.needs_vehicle:
            self._vehicle_for(f"law = {self.law!r}")
        return self

    def _vehicle_for(self, key: str) -> VehicleModelSettings:
        """Return the nominal vehicle, without which a setting is refused."""
        if not isinstance(self.nominal_model, VehicleModelSettings):
            raise ValueError(f"{key} needs nominal_model.kind = 'vehicle'")
        return self.nominal_model

    @model_validator(mode="after")
    def _refuse_a_second_feed_forward(self) -> Self:
        if self.feed_forward is not None:
            if self.law_record.feed_forward_refusal:
                raise ValueError(f"law = {self.law!r} {self.law_record.feed_forward_refusal}")
            self._vehicle_for("[feed_forward]")
        return self

    @model_validator(mode="after")
    def _refuse_another_point_without_a_vehicle(self) -> Self:
        key = f"followed_point = {self.followed_point!r}"
        if self.followed_point != "preview" and not self._vehicle_for(key).preview_distance_m:
            raise ValueError(f"{key} needs nominal_model.preview_distance_m above 0")
        return self

    @model_validator(mode="after")
    def _refuse_cutoffs_beyond_nyquist(self) -> Self:
        nyquist_rad_s = pi * self.rate_hz
        for key, cutoff_rad_s in self._cutoffs_rad_s().items():
            if cutoff_rad_s is not None and cutoff_rad_s >= nyquist_rad_s:
                raise ValueError(
                    f"{key} = {cutoff_rad_s:g} must be below pi * rate_hz = {nyquist_rad_s:.4g}"
                    f" rad/s (Nyquist at rate_hz = {self.rate_hz:g})"
                )
        return self

    def _cutoffs_rad_s(self) -> dict[str, float | None]:
        """Return every cutoff by its key [rad/s]; None where it is omitted."""
        cutoffs: dict[str, float | None] = {}
        if self.pd is not None:
            cutoffs["pd.derivative_filter_rad_s"] = self.pd.derivative_filter_rad_s
        if self.dob is not None:
            cutoffs["dob.q_cutoff_rad_s"] = self.dob.q_cutoff_rad_s
        if self.cdob is not None:
            cutoffs["cdob.q_cutoff_rad_s"] = self.cdob.q_cutoff_rad_s
            cutoffs["cdob.washout_rad_s"] = self.cdob.washout_rad_s
        for name, law in {**LAWS, "own_law": self.law_record}.items():
            if law.cutoffs and (table := getattr(self, name)) is not None:
                cutoffs |= {f"{name}.{key}": getattr(table, key) for key in law.cutoffs}
        return cutoffs
