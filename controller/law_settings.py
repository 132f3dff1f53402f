"""Settings of the control laws: the tables of each law, [estimator], [link] and [nominal_model].

They hold continuous-time values; ``controller.design`` turns them into discrete filters at the
configured rate. Anything a filter could not be built from is refused here, naming the key.
"""

from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from controller.laws import KALMAN_LAWS, LawName
from controller.nominal_model import NominalVehicle, paper_eq19, vehicle_model
from controller.transfer_function import TransferFunction
from runtime.settings import Settings

CutoffRadS = Annotated[float, Field(ge=1e-6, le=1e4)]
"""Beyond these ranges, and those of the vehicle below, products of values would overflow."""


class PdSettings(Settings):
    """C(s) = K_p + K_d s/(s/N + 1)."""

    proportional_gain_rad_m: Annotated[float, Field(gt=0.0, le=1e6)]  # K_p
    derivative_gain_rad_s_m: Annotated[float, Field(ge=0.0, le=1e6)]  # K_d
    derivative_filter_rad_s: CutoffRadS | None = None  # N; omitted: the ideal derivative
    derivative: Literal["filtered", "kalman"] = "filtered"
    """kalman: that of the measured error from the filter of [estimator], while echoes come."""


class DobSettings(Settings):
    """Q of the disturbance observer.

    order_2: ω²/(s + ω)², (20). type_2: (3τs + 1)/(τs + 1)³ with τ = 1/ω, whose 1 - Q has a double
    zero at s = 0, so that a ramp of the disturbance is rejected too, up to half a control period's
    worth that sampling leaves.
    """

    q_cutoff_rad_s: CutoffRadS  # ω
    q_kind: Literal["order_2", "type_2"] = "order_2"


class CdobSettings(Settings):
    """Q of the communication disturbance observer, (20), and the washout (s/(s + ω_h))²."""

    q_cutoff_rad_s: CutoffRadS
    washout_rad_s: CutoffRadS | None = None  # ω_h; omitted: no washout, as published


class PaperEq19Settings(Settings):
    """Nominal model (19), as printed."""

    kind: Literal["paper_eq19"]

    @property
    def model(self) -> TransferFunction:
        """Return G_n."""
        return paper_eq19()


MassKg = Annotated[float, Field(ge=1.0, le=1e7)]
YawInertiaKgM2 = Annotated[float, Field(ge=1e-2, le=1e9)]
StiffnessNRad = Annotated[float, Field(ge=1.0, le=1e9)]
AxleDistanceM = Annotated[float, Field(ge=1e-3, le=100.0)]
PreviewDistanceM = Annotated[float, Field(ge=0.0, le=1000.0)]
SpeedMS = Annotated[float, Field(ge=1e-2, le=200.0)]


class VehicleModelSettings(Settings):
    """Nominal model from vehicle parameters; see ``NominalVehicle`` for the paper's symbols."""

    kind: Literal["vehicle"]
    virtual_mass_kg: MassKg
    yaw_inertia_kg_m2: YawInertiaKgM2
    front_cornering_stiffness_n_rad: StiffnessNRad
    rear_cornering_stiffness_n_rad: StiffnessNRad
    front_axle_distance_m: AxleDistanceM
    rear_axle_distance_m: AxleDistanceM
    preview_distance_m: PreviewDistanceM
    speed_m_s: SpeedMS

    @property
    def model(self) -> TransferFunction:
        """Return G_n."""
        return vehicle_model(NominalVehicle(**self.model_dump(exclude={"kind"})))

    @model_validator(mode="after")
    def _refuse_a_model_without_stable_inverse(self) -> Self:
        _ = self.model
        return self


class LinkSettings(Settings):
    """[link]: what is known of the plant's sensors, and how the delay is measured."""

    sensor_period_ms: Annotated[float, Field(ge=1.0, le=100.0)] = 10.0
    """Between two LATERAL_ERROR of the plant; the default is the DBC's cycle time."""
    delay_averaging_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.5
    """Time constant of the mean of the delays that echoes show."""

    @property
    def sensor_period_s(self) -> float:
        """The sensors' period [s]."""
        return self.sensor_period_ms * 1e-3


class EstimatorSettings(Settings):
    """[estimator]: what the Kalman filter takes for noise, and at which speeds it is designed.

    Noise densities are standard deviations after one second; of the measurements, per sample.
    """

    lateral_error_noise_m: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    heading_error_noise_rad: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    side_slip_noise_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.001
    yaw_rate_noise_rad_s_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.01
    curvature_walk_1_m_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.02
    steering_offset_walk_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.005
    actuator_lag_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Of the wheel behind the command, if known."""
    speed_m_s_min: Annotated[float, Field(ge=0.1, le=80.0)] = 0.5
    speed_m_s_max: Annotated[float, Field(ge=0.1, le=80.0)] = 25.0

    @model_validator(mode="after")
    def _refuse_an_empty_range_of_speeds(self) -> Self:
        if self.speed_m_s_max <= self.speed_m_s_min:
            raise ValueError(
                f"speed_m_s_max = {self.speed_m_s_max:g} must be above"
                f" speed_m_s_min = {self.speed_m_s_min:g}"
            )
        return self


class PredictorSettings(Settings):
    """[predictor]: what its feedback takes for a large error, and how far ahead it looks."""

    steer_per_error_rad_m: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """Weight of the lateral error in the feedback's cost: this much steer is as bad as a metre."""
    horizon_s_max: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    """Of prediction; beyond it the law is pd_ddob."""


class SmithSettings(Settings):
    """[smith]: the delay that the model has, and the washout (s/(s + ω_h))²."""

    delay_s: Annotated[float, Field(ge=0.0, le=2.0)]
    """From sending a command until its effect is measured, there and back; never adapted."""
    washout_rad_s: CutoffRadS | None = None  # ω_h; omitted: no washout, the vehicle drifts


class DelayedSetPointSettings(Settings):
    """[delayed_set_point]: the loop of the yaw rate; the outer one is [pd]."""

    delay_s: Annotated[float, Field(ge=0.0, le=2.0)] | None = None
    """From asking for a yaw rate until it is measured; omitted: measured by the echo."""
    proportional_gain: Annotated[float, Field(ge=0.0, le=10.0)]
    """1: a yaw rate error is met by the steer that makes it good in the steady state."""
    integral_gain_1_s: Annotated[float, Field(ge=0.0, le=100.0)]


class FeedForwardSettings(Settings):
    """[feed_forward]: adds the steer that holds the curve the map tells of, to any law."""

    gain: Annotated[float, Field(ge=0.0, le=2.0)] = 1.0
    """Share of the nominal vehicle's steady-state steer."""


NominalModelSettings = Annotated[
    PaperEq19Settings | VehicleModelSettings, Field(discriminator="kind")
]


class LawSettings(Settings):
    """What ``controller.design`` needs; a law's tables may be left out where the law has no use."""

    law: LawName
    rate_hz: Annotated[float, Field(ge=10.0, le=1000.0)] = 100.0
    pd: PdSettings
    dob: DobSettings | None = None
    cdob: CdobSettings | None = None
    predictor: PredictorSettings | None = None
    smith: SmithSettings | None = None
    delayed_set_point: DelayedSetPointSettings | None = None
    feed_forward: FeedForwardSettings | None = None
    estimator: EstimatorSettings = EstimatorSettings()
    link: LinkSettings = LinkSettings()
    nominal_model: NominalModelSettings | None = None

    @property
    def model(self) -> TransferFunction | None:
        """Return G_n, or None where there is no [nominal_model]."""
        return None if self.nominal_model is None else self.nominal_model.model

    @model_validator(mode="after")
    def _refuse_missing_tables(self) -> Self:
        needed = {
            LawName.PD: (),
            LawName.PD_DOB: ("dob", "nominal_model"),
            LawName.PD_CDOB: ("cdob", "nominal_model"),
            LawName.PD_DDOB: ("dob", "cdob", "nominal_model"),
            LawName.PREDICTOR: ("predictor", "dob", "cdob", "nominal_model"),
            LawName.SMITH: ("smith", "nominal_model"),
            LawName.DELAYED_SET_POINT: ("delayed_set_point", "nominal_model"),
        }
        for table in needed[self.law]:
            if getattr(self, table) is None:
                raise ValueError(f"law = {self.law.value!r} needs the table [{table}]")
        is_vehicle = isinstance(self.nominal_model, VehicleModelSettings)
        if self.law in (LawName.PREDICTOR, LawName.DELAYED_SET_POINT) and not is_vehicle:
            raise ValueError(f"law = {self.law.value!r} needs nominal_model.kind = 'vehicle'")
        return self

    @model_validator(mode="after")
    def _refuse_an_estimate_without_a_vehicle(self) -> Self:
        if self.pd.derivative == "kalman":
            if self.law not in KALMAN_LAWS:
                raise ValueError(f"pd.derivative = 'kalman' is not for law = {self.law.value!r}")
            if not isinstance(self.nominal_model, VehicleModelSettings):
                raise ValueError("pd.derivative = 'kalman' needs nominal_model.kind = 'vehicle'")
        return self

    @model_validator(mode="after")
    def _refuse_a_second_feed_forward(self) -> Self:
        if self.feed_forward is None:
            return self
        if self.law is LawName.PREDICTOR:
            raise ValueError(
                "law = 'predictor' steers for the curvature that it estimates: leave out"
                " [feed_forward], or take another law"
            )
        if self.law is LawName.DELAYED_SET_POINT:
            raise ValueError(
                "law = 'delayed_set_point' takes the map's curvature by itself: leave out"
                " [feed_forward]"
            )
        if not isinstance(self.nominal_model, VehicleModelSettings):
            raise ValueError("[feed_forward] needs nominal_model.kind = 'vehicle'")
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
        """Return every cutoff by its key [rad/s]; None where it is left out."""
        cutoffs = {"pd.derivative_filter_rad_s": self.pd.derivative_filter_rad_s}
        if self.dob is not None:
            cutoffs["dob.q_cutoff_rad_s"] = self.dob.q_cutoff_rad_s
        if self.cdob is not None:
            cutoffs["cdob.q_cutoff_rad_s"] = self.cdob.q_cutoff_rad_s
            cutoffs["cdob.washout_rad_s"] = self.cdob.washout_rad_s
        if self.smith is not None:
            cutoffs["smith.washout_rad_s"] = self.smith.washout_rad_s
        return cutoffs
