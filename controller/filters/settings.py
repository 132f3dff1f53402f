"""Tables of settings that several control laws share; a law's own table is in its module.

They hold continuous-time values; ``controller.laws.design`` turns them into discrete filters at the
configured rate.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...runtime.settings import Settings
from .nominal_model import NominalVehicle, paper_eq19, vehicle_model
from .transfer_function import TransferFunction

CutoffRadS = Annotated[float, Field(ge=1e-6, le=1e4)]
"""Beyond these ranges, and those of the vehicle below, products of values would overflow."""


class PdSettings(Settings):
    """C(s) = K_p + K_d s/(s/N + 1)."""

    proportional_gain_rad_m: Annotated[float, Field(gt=0.0, le=1e6)]  # K_p
    derivative_gain_rad_s_m: Annotated[float, Field(ge=0.0, le=1e6)]  # K_d
    derivative_filter_rad_s: CutoffRadS | None = None  # N; omitted: the ideal derivative
    derivative: Literal["filtered", "kalman"] = "filtered"
    """kalman: derivative of the measured error from the filter of [estimator], with echoes only."""


class DobSettings(Settings):
    """Q of the disturbance observer.

    order_2: ω²/(s + ω)², (20). type_2: (3τs + 1)/(τs + 1)³ with τ = 1/ω, whose 1 - Q has a double
    zero at s = 0, so that a ramp of the disturbance is rejected too. Sampling leaves an error of up
    to half a control period of the ramp.
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
    def vehicle(self) -> NominalVehicle:
        """Return the vehicle."""
        return NominalVehicle(**self.model_dump(exclude={"kind"}))

    @property
    def model(self) -> TransferFunction:
        """Return G_n."""
        return vehicle_model(self.vehicle)

    @model_validator(mode="after")
    def _refuse_a_model_without_stable_inverse(self) -> Self:
        _ = self.model
        return self


class LinkSettings(Settings):
    """[link]: the period of the plant's sensors, and the measurement of the delay."""

    sensor_period_ms: Annotated[float, Field(ge=1.0, le=100.0)] = 10.0
    """Period of the plant's LATERAL_ERROR; the default is the DBC's cycle time."""
    delay_averaging_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.5
    """Time constant for averaging the delays measured by echoes."""

    @property
    def sensor_period_s(self) -> float:
        """The sensors' period [s]."""
        return self.sensor_period_ms * 1e-3


class EstimatorSettings(Settings):
    """[estimator]: noise that the Kalman filter assumes, and speeds for which it is designed.

    Noise densities are standard deviations after one second; those of measurements are per sample.
    """

    lateral_error_noise_m: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    heading_error_noise_rad: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    side_slip_noise_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.001
    yaw_rate_noise_rad_s_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.01
    curvature_walk_1_m_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.02
    steering_offset_walk_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.005
    actuator_lag_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Lag of the wheel behind the command, if known."""
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


FollowedPoint = Literal["preview", "centre_of_gravity", "rear_axle"]
"""The point of the vehicle that a law holds on the path."""


class FeedForwardSettings(Settings):
    """[feed_forward]: adds to any law the steady-state steer of the curve given by the map."""

    gain: Annotated[float, Field(ge=0.0, le=2.0)] = 1.0
    """Share of the nominal vehicle's steady-state steer."""


NominalModelSettings = Annotated[
    PaperEq19Settings | VehicleModelSettings, Field(discriminator="kind")
]
