"""Tables [pd], [dob], [cdob] and [nominal_model], which several control laws share.

They hold continuous-time values; ``controller.filters.discretization`` turns them into discrete
filters at the configured rate.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...runtime.settings import Settings
from .nominal_model import NominalVehicle, paper_eq19, vehicle_model
from .transfer_function import TransferFunction

CutoffRadS = Annotated[float, Field(ge=1e-6, le=1e4)]
"""Beyond these ranges, and those of the vehicle below, products of values would overflow."""
QKind = Literal["order_2", "type_2"]


class PdSettings(Settings):
    """C(s) = K_p + K_d s/(s/N + 1)."""

    proportional_gain_rad_m: Annotated[float, Field(gt=0.0, le=1e6)]  # K_p
    derivative_gain_rad_s_m: Annotated[float, Field(ge=0.0, le=1e6)]  # K_d
    derivative_filter_rad_s: CutoffRadS | None = None  # N; omitted: the ideal derivative


class DobSettings(Settings):
    """Q of the disturbance observer.

    order_2: ω²/(s + ω)², (20). type_2: (3τs + 1)/(τs + 1)³ with τ = 1/ω, whose 1 - Q has a double
    zero at s = 0, so that a ramp of the disturbance is rejected too. Sampling leaves an error of up
    to half a control period of the ramp.
    """

    q_cutoff_rad_s: CutoffRadS  # ω
    q_kind: QKind = "order_2"


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


NominalModelSettings = Annotated[
    PaperEq19Settings | VehicleModelSettings, Field(discriminator="kind")
]
