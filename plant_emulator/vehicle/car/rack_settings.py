"""Settings table `[car.rack]`: a rack and a motor that steer the car; the rest is `[actuator]`.

``actuator.lag_s`` is the time constant of its position loop, and the other keys of `[actuator]` are
limits and dead band of that loop. Where no source stands, a default is chosen: no data sheet of a
rack gives all of them.
"""

from typing import Literal, Self

from pydantic import Field, model_validator

from ....runtime.settings import Settings
from ..settings import ActuatorSettings, VehicleSettings
from .rack import RackParams
from .rack_friction import FrictionParams

LAG_S_MIN = 0.005
_STOP_RAD = 1.5


class RackSettings(Settings):
    """`[car.rack]`; the defaults suit a passenger car."""

    mass_kg: float = Field(120.0, ge=1e-4, le=10_000.0)
    """Of rack, and of the wheels about their kingpins, as felt at the rack."""
    motor_inertia_kg_m2: float = Field(1e-4, ge=0.0, le=1.0)
    gear_rad_m: float = Field(900.0, ge=1.0, le=1e6)
    """Turn of the motor over travel of the rack."""
    arm_m: float = Field(0.14, ge=1e-3, le=2.0)
    """Travel of the rack over angle of the wheels."""
    play_rad: float = Field(0.0, ge=0.0, le=0.1)
    """Of the wheels behind the rack, to each side; its sensor does not see it."""
    wheel_damping_n_m_s_rad: float = Field(20.0, ge=1e-6, le=1e5)
    """Of the wheels about their kingpins."""
    damping_n_s_m: float = Field(1000.0, ge=0.0, le=1e6)
    friction: Literal["coulomb", "lugre"] = "coulomb"
    friction_m_s2: float = Field(0.141, ge=0.0, le=10.0)
    """Lateral acceleration whose aligning torque is the Coulomb friction: the median of the 80 cars
    in opendbc 0.3.1, ``torque_data/params.toml``. No force of a rack is published; the force here
    is derived from it by the car's front axle and trails."""
    static_share: float = Field(1.0, ge=1.0, le=5.0)
    """Static over Coulomb friction (LuGre)."""
    stribeck_m_s: float = Field(0.001, ge=1e-6, le=1.0)
    bristle_m: float = Field(1e-4, ge=1e-7, le=0.01)
    """Deflection at which the bristles carry the Coulomb friction."""
    bristle_damping_n_s_m: float = Field(1000.0, ge=0.0, le=1e6)
    caster_trail_m: float = Field(0.02, ge=-0.2, le=0.5)
    pneumatic_trail_m: float = Field(0.03, ge=0.0, le=0.5)
    """Without slip: a third of half the length of the contact patch."""
    torque_n_m_a: float = Field(0.05, ge=1e-5, le=10.0)
    """Of the motor, over its current."""
    resistance_ohm: float = Field(0.05, ge=1e-4, le=1000.0)
    current_a_max: float = Field(100.0, ge=0.01, le=1000.0)
    voltage_v_max: float = Field(12.0, ge=0.1, le=1000.0)
    loop_rad_s: float = Field(100.0, ge=1.0, le=1000.0)
    """Bandwidth of the loop of the rack's speed, inside the position loop."""
    loop_period_ms: float = Field(1.0, ge=1.0, le=50.0)

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        if self.loop_rad_s * self.loop_period_ms > 500.0:
            raise ValueError(
                f"loop_period_ms = {self.loop_period_ms:g} is too long for loop_rad_s ="
                f" {self.loop_rad_s:g}: at most {500.0 / self.loop_rad_s:g}"
            )
        least = self.bristle_damping_n_s_m * (self.static_share - 1.0)
        if self.friction == "lugre" and self.damping_n_s_m < least:
            raise ValueError(
                f"damping_n_s_m = {self.damping_n_s_m:g}: friction would create energy; at least"
                f" bristle_damping_n_s_m (static_share - 1) = {least:g}"
            )
        return self


def rack_params(
    rack: RackSettings, actuator: ActuatorSettings, vehicle: VehicleSettings
) -> RackParams:
    """Return the constants of the equations, for a car of ``vehicle``.

    The actuator has a lag of LAG_S_MIN or more and a limit of its rate.
    """
    arm_m, square_m2 = rack.arm_m, rack.arm_m**2
    motor_n_m_a = rack.torque_n_m_a * rack.gear_rad_m * arm_m
    wheelbase_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    front_kg = vehicle.virtual_mass_kg * vehicle.rear_axle_distance_m / wheelbase_m
    trails_m = rack.caster_trail_m + rack.pneumatic_trail_m
    coulomb_n_m = rack.friction_m_s2 * front_kg * abs(trails_m)
    is_lugre = rack.friction == "lugre" and coulomb_n_m > 0.0
    angle_rad = actuator.angle_limit_rad
    return RackParams(
        inertia_kg_m2=(rack.mass_kg + rack.motor_inertia_kg_m2 * rack.gear_rad_m**2) * square_m2,
        damping_n_m_s=rack.damping_n_s_m * square_m2,
        friction=FrictionParams(
            coulomb_n_m,
            coulomb_n_m * rack.static_share,
            coulomb_n_m * arm_m / rack.bristle_m if is_lugre else 0.0,
            rack.bristle_damping_n_s_m * square_m2,
            rack.stribeck_m_s / arm_m,
        ),
        motor_n_m_a=motor_n_m_a,
        motor_a_n_m=1.0 / motor_n_m_a,
        resistance_ohm=rack.resistance_ohm,
        voltage_v_max=rack.voltage_v_max,
        current_a_max=rack.current_a_max,
        arm_1_m=1.0 / arm_m,
        play_rad=rack.play_rad,
        wheel_damping_n_m_s=rack.wheel_damping_n_m_s_rad,
        wheel_damping_1_n_m_s=1.0 / rack.wheel_damping_n_m_s_rad,
        caster_trail_m=rack.caster_trail_m,
        pneumatic_trail_m=rack.pneumatic_trail_m,
        lag_1_s=1.0 / actuator.lag_s,
        loop_1_s=rack.loop_rad_s,
        period_s=1e-3 * rack.loop_period_ms,
        angle_limit_rad=_STOP_RAD if angle_rad is None else angle_rad,
        rate_limit_rad_s=actuator.rate_limit_rad_s or 0.0,
        dead_band_rad=actuator.dead_band_rad,
    )
