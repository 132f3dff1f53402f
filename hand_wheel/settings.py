"""``HandWheelSettings``: the settings of hand wheel and driver, one table for each subject."""

from math import ceil
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ..dbc.codec.counter_rule import CounterRule
from ..runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S
from ..runtime.node.overruns import OverrunSettings
from ..runtime.settings import Settings, SharedTable, read_table
from .analysis.nominal_road import OF_VEHICLE, Rack, road_torque, road_vehicle
from .cycle import CycleParams
from .driver import BLIND, DriverParams, Kick, TwoPointParams
from .feedback_laws import FEEDBACK_LAWS, FeedbackParams
from .modes import FeedbackSupervision
from .wheel import GRIPS, LinearSystem, WheelSettings, kept_of
from .wheel_step import WheelParams, wheel_params

PRESETS = "steer_by_wire.hand_wheel.presets"
"""The package with the presets that are shipped."""
STEP_S_MAX = 0.001
"""Longest step of the wheel's motion; a firmly held wheel swings 300 times as slowly."""
_WHEEL = WheelSettings.model_fields
_Gain = Annotated[float, Field(ge=0.0, le=1000.0)]


class KickSettings(Settings):
    """One `[[driver.kicks]]`: a torque that the driver adds to that of his arms."""

    at_s: float = Field(ge=0.0, le=1e6)
    lasts_s: float = Field(0.1, ge=0.001, le=1e6)
    torque_n_m: float = Field(3.0, ge=-20.0, le=20.0)


class TwoPointSettings(Settings):
    """`[driver.two_point]`: a driver who follows the path by sight (``driver``).

    Structure and points after Salvucci and Gray (2004). With their gains of 16, 4 and 3 this car
    and these arms swing: these are chosen, to hold a double lane change at 45 and 60 km/h.
    """

    far_gain: _Gain = 9.0
    near_gain: _Gain = 3.0
    integral_gain_1_s: _Gain = 3.0
    near_rad_max: float = Field(0.07, gt=0.0, le=1.0)
    near_m: float = Field(8.0, ge=1.0, le=100.0)
    far_s: float = Field(0.9, ge=0.1, le=10.0)
    reaction_s: float = Field(0.12, ge=0.0, le=2.0)
    """This value and the next are from Chinese Journal of Mechanical Engineering, table 1,
    10.1186/s10033-020-00477-9."""
    neuromuscular_lag_s: float = Field(0.11, ge=1e-3, le=2.0)


class DriverSettings(Settings):
    """`[driver]`: how the driver holds the wheel, and what he does with it."""

    grip: Literal["hands_off", "loose", "light", "firm"] = "light"
    let_go_at_s: float | None = Field(None, ge=0.0, le=1e6)
    """When he takes his hands off the wheel; if omitted, never."""
    kicks: tuple[KickSettings, ...] = Field((), max_length=1000)
    two_point: TwoPointSettings | None = None
    """If omitted, he holds the wheel straight."""


class NominalModelSettings(Settings):
    """`[nominal_model]`: vehicle and steering that the feedback assumes; a sedan, chosen."""

    speed_m_s: float = Field(80.0 / 3.6, ge=0.13, le=70.0)
    virtual_mass_kg: float = Field(1750.0, ge=0.1, le=100_000.0)
    yaw_inertia_kg_m2: float = Field(2900.0, ge=1e-4, le=1_000_000.0)
    front_cornering_stiffness_n_rad: float = Field(110_000.0, ge=1.0, le=10_000_000.0)
    rear_cornering_stiffness_n_rad: float = Field(150_000.0, ge=1.0, le=10_000_000.0)
    front_axle_distance_m: float = Field(1.25, gt=0.0, le=20.0)
    rear_axle_distance_m: float = Field(1.55, gt=0.0, le=20.0)
    preview_distance_m: float = Field(2.0, ge=0.0, le=100.0)
    """To the point whose lateral error is on the bus; only the driver's sight needs it."""
    actuator_lag_s: float = Field(0.0, ge=0.0, le=10.0)
    trail_m: float = Field(0.05, gt=0.0, le=0.5)
    arm_m: float = Field(0.14, ge=1e-3, le=2.0)
    of_vehicle: ClassVar = (*OF_VEHICLE, "preview_distance_m")
    """Keys that the plant's [vehicle] has too."""


class FeedbackSettings(Settings):
    """`[feedback]`: the law, and the damping and friction that the motor adds."""

    law: Literal["rack_force", "spring", "model", "cdob", "dob"] = "rack_force"
    torque_gradient_n_m: float = Field(6.0, ge=0.0, le=1000.0)
    """Torque for each radian of the hand wheel while the vehicle does not move sideways; chosen."""
    cutoff_rad_s: float = Field(50.0, ge=0.1, le=1000.0)
    """Bandwidth of cdob and dob."""
    dob_inertia_kg_m2: float = Field(_WHEEL["inertia_kg_m2"].default, ge=0.0, le=10.0)
    """Inertia that the dob lets the driver feel; the default is that of the wheel."""
    dob_damping_n_m_s: float = Field(_WHEEL["damping_n_m_s"].default, ge=0.0, le=100.0)
    """Damping that the dob lets the driver feel."""
    washout_rad_s: float = Field(2.0, ge=0.0, le=100.0)
    """Washout of the cdob: slower torque comes from the road alone. 0 switches it off."""
    damping_n_m_s: float = Field(0.0, ge=0.0, le=100.0)
    friction_n_m: float = Field(0.0, ge=0.0, le=10.0)
    friction_rad_s: float = Field(0.1, ge=0.001, le=10.0)
    """Rate of the wheel above which that friction is full."""
    passive_n_m_s_max: float = Field(0.0, ge=0.0, le=100.0)
    """Largest damping of the passivity controller; 0 switches it off."""
    servo_n_m: float = Field(8.0, ge=0.0, le=1000.0)
    """Stiffness with which the wheel follows the road wheels while the law steers; chosen."""
    servo_n_m_s: float = Field(0.6, ge=0.0, le=100.0)


class SupervisionSettings(Settings):
    """`[supervision]`: what happens when the road falls silent."""

    timeout_ms: float = Field(100.0, ge=1.0, le=10_000.0)
    hold_ms: float = Field(100.0, ge=0.0, le=10_000.0)
    """How long the newest message is still used after the timeout."""
    fade_ms: float = Field(500.0, ge=1.0, le=60_000.0)
    """Time from full feedback to none, and back."""
    recovery_frames: int = Field(5, ge=1, le=100)
    fallback_damping_n_m_s: float = Field(0.5, ge=0.0, le=100.0)
    """Local damping that takes the place of the feedback."""
    counter_lead_ms: float = Field(300.0, ge=0.0, le=10_000.0)
    """How much earlier a frame may come than its counter explains."""


class HandWheelSettings(Settings):
    """One hand wheel with its driver."""

    cycle_ms: float = Field(10.0, ge=1.0, le=20.0)
    """Period of HAND_WHEEL_STATE and of the feedback law."""
    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Used until a HAND_WHEEL_FEEDBACK states the ratio."""
    wheel: WheelSettings = WheelSettings()
    driver: DriverSettings = DriverSettings()
    feedback: FeedbackSettings = FeedbackSettings()
    nominal_model: NominalModelSettings = NominalModelSettings()
    supervision: SupervisionSettings = SupervisionSettings()
    overruns: OverrunSettings = OverrunSettings()

    @property
    def cycle_ns(self) -> int:
        """Period of the feedback [ns]."""
        return round(self.cycle_ms * NS_PER_MS)

    @property
    def cycle_s(self) -> float:
        """Period of the feedback [s]."""
        return self.cycle_ns / NS_PER_S

    @property
    def steps(self) -> int:
        """Number of steps of the wheel's motion in a cycle."""
        return ceil(self.cycle_s / STEP_S_MAX - 1e-9)

    @property
    def wheel_params(self) -> WheelParams:
        """Constants of a step of the wheel's motion."""
        return wheel_params(self.wheel, self.cycle_s / self.steps)

    @property
    def nominal_way(self) -> LinearSystem:
        """Nominal system from hand wheel angle to the road's torque, without a bus."""
        model, gradient_n_m = self.nominal_model, self.feedback.torque_gradient_n_m
        return road_torque(road_vehicle(model), gradient_n_m, Rack(lag_s=model.actuator_lag_s))

    @property
    def feedback_params(self) -> FeedbackParams:
        """Constants of the law; computing them takes some milliseconds."""
        # Loads scipy, and every run reads settings.
        from .analysis.sampled_laws import dob_gains, sampled_model

        table, model, ratio = self.feedback, self.nominal_model, self.steering_ratio
        gradient = table.torque_gradient_n_m
        force_n_rad = model.front_cornering_stiffness_n_rad * model.trail_m / model.arm_m
        observer = table.dob_inertia_kg_m2, table.dob_damping_n_m_s, self.cycle_s
        return FeedbackParams(
            gradient * ratio / force_n_rad,
            gradient * ratio,
            *sampled_model(self.nominal_way, self.cycle_s),
            kept_of(table.cutoff_rad_s, self.cycle_s),
            kept_of(table.washout_rad_s, self.cycle_s),
            *dob_gains(*observer, table.cutoff_rad_s),
            table.damping_n_m_s,
            table.friction_n_m,
            table.friction_rad_s,
            table.passive_n_m_s_max,
            self.cycle_s,
        )

    @property
    def cycle_params(self) -> CycleParams:
        """Constants of a cycle."""
        table, two, cycle_s = self.feedback, self.driver.two_point, self.cycle_s
        two_point = BLIND if two is None else TwoPointParams(
            two.far_gain, two.near_gain, two.integral_gain_1_s, two.near_rad_max,
            two.near_m, two.far_s, max(1, round(two.reaction_s / cycle_s)),
            kept_of(1.0 / two.neuromuscular_lag_s, cycle_s),
        )  # fmt: skip
        return CycleParams(
            DriverParams(GRIPS[self.driver.grip], two_point, cycle_s),
            self.feedback_params,
            [*FEEDBACK_LAWS].index(table.law),
            table.servo_n_m,
            table.servo_n_m_s,
            self.supervision.fallback_damping_n_m_s,
        )

    @property
    def kicks(self) -> tuple[Kick, ...]:
        """Kicks of the driver."""
        return tuple(
            Kick(_ns(kick.at_s), _ns(kick.at_s + kick.lasts_s), kick.torque_n_m)
            for kick in self.driver.kicks
        )

    @property
    def let_go_ns(self) -> int:
        """When the driver takes his hands off [ns]."""
        let_go_at_s = self.driver.let_go_at_s
        return NEVER_NS if let_go_at_s is None else _ns(let_go_at_s)

    @property
    def mode_params(self) -> FeedbackSupervision:
        """Constants of the mode table."""
        table = self.supervision
        return FeedbackSupervision(
            round(table.timeout_ms * NS_PER_MS),
            round(table.hold_ms * NS_PER_MS),
            table.recovery_frames,
            self.cycle_ms / table.fade_ms,
            FEEDBACK_LAWS[self.feedback.law].reads is not None,
        )

    @property
    def counters(self) -> CounterRule:
        """Which counters of received frames are accepted."""
        table, times = self.supervision, self.mode_params
        resync_ns = times.timeout_ns + self.cycle_ns + 1
        return CounterRule(
            round(table.counter_lead_ms * NS_PER_MS), table.recovery_frames, resync_ns
        )


def shared_vehicle(file: Path | None) -> SharedTable | None:
    """Return [vehicle] of a file that the plant reads too, as [nominal_model]; SettingsError."""
    if file is None:
        return None
    known = NominalModelSettings.of_vehicle
    model = {key: value for key, value in read_table(file, "vehicle").items() if key in known}
    return SharedTable(str(file), {"nominal_model": model})


def _ns(time_s: float) -> int:
    return round(time_s * NS_PER_S)
