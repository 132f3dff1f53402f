"""The rack: motor, gear and wheels as one inertia, with friction that sticks, and play.

Everything is reduced to the angle of the wheels: a force on the rack counts by the steering arm r,
its travel over that angle.

    J ω̇ = k I − d ω − M_f + M             J = (m + J_m i²) r²,   k = k_t i r
    U = R I + k ω,   |U| <= U_max,   |I| <= I_max        so the rate falls with the load
    M = −F_y (n_c + n) − c ω     while the wheels touch a side of their play, else 0
    n = n_0 (1 − θ)³/(1 − θ + θ²/3),   θ = C |α′|/(3 D) <= 1

    ω, d     rate of the rack over r, its viscous damping                [rad/s, N m s/rad]
    M_f      friction (``rack_friction``)                                             [N m]
    I, U, R  current, voltage and resistance of the motor; inductance is neglected [A, V, Ω]
    k_t, i, J_m  its torque constant, turn over travel, inertia      [N m/A, rad/m, kg m²]
    M        moment of the front tyres about their kingpins, left positive            [N m]
    F_y      their lateral force [N]         c    damping of the wheels       [N m s/rad]
    n_c, n   caster trail and pneumatic trail, which vanishes at the limit of grip      [m]

Every ``period_s`` the unit's position loop asks for the current of the moment

    J a (w − ω) + ∫ J a²/4 (w − ω) dt,        w = (target − δ)/T within the rate limit

Trail: brush model, Pacejka, Tire and Vehicle Dynamics (2012), section 3.2. The step is
semi-implicit; the tyres' force is that at its start. Not here: the torque that turns tyres on the
spot, and the elasticity of the tie rods.
"""

from typing import NamedTuple

from .rack_friction import FrictionParams, moved
from .steering_input import SteeringInput

_IN_TIME_S = 1e-6
"""A tick of the loop that is due within this time is due."""


class RackParams(NamedTuple):
    """The symbols above; limits and dead band as in `[actuator]`.

    ``lag_1_s``, ``loop_1_s``  1/T and a       ``motor_a_n_m``  1/k, because a division takes long
    ``play_rad``               of the wheels, to each side
    """

    inertia_kg_m2: float
    damping_n_m_s: float
    friction: FrictionParams
    motor_n_m_a: float
    motor_a_n_m: float
    resistance_ohm: float
    voltage_v_max: float
    current_a_max: float
    arm_1_m: float
    play_rad: float
    wheel_damping_n_m_s: float
    wheel_damping_1_n_m_s: float
    caster_trail_m: float
    pneumatic_trail_m: float
    lag_1_s: float
    loop_1_s: float
    period_s: float
    angle_limit_rad: float
    rate_limit_rad_s: float
    dead_band_rad: float


class RackState(NamedTuple):
    """The first four as of every steering.

    ``rack_force_n``  M/r
    ``rack_rad``      travel of the rack over r
    ``gap_rad``       angle of the wheels less that: within the play
    ``bristle_rad``   deflection of LuGre's bristles
    ``wait_s``        until the next tick of the position loop
    ``asked_a``       current that it asks for, and its integral
    """

    wheel_rad: float
    wheel_rate_rad_s: float
    is_limited: bool
    road_rad: float
    rack_force_n: float
    rack_rad: float
    gap_rad: float
    bristle_rad: float
    wait_s: float
    asked_a: float
    integral_n_m: float


RACK_AT_REST = RackState(0.0, 0.0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def rack_step(p: RackParams, x: RackState, inputs: SteeringInput, h_s: float) -> RackState:
    """Return the state after ``h_s`` > 0."""
    _, rate_rad_s, is_limited, _, _, rack_rad, gap_rad, bristle_rad, wait_s, asked_a, integral = x
    k = p.motor_n_m_a

    if wait_s <= _IN_TIME_S:
        wait_s += p.period_s
        target_rad = min(max(inputs.command_rad, -p.angle_limit_rad), p.angle_limit_rad)
        error_rad = target_rad - (rack_rad + inputs.sensor_rad)
        error_rad -= min(max(error_rad, -p.dead_band_rad), p.dead_band_rad)
        fastest_rad_s = p.rate_limit_rad_s * inputs.rate_share
        wanted_rad_s = min(max(error_rad * p.lag_1_s, -fastest_rad_s), fastest_rad_s)
        lack_n_m = p.inertia_kg_m2 * p.loop_1_s * (wanted_rad_s - rate_rad_s)
        wanted_a = (lack_n_m + integral) * p.motor_a_n_m
        most_a = p.current_a_max * inputs.torque_share
        asked_a = min(max(wanted_a, -most_a), most_a)
        # At its limits the integral only shrinks; within the dead band it stays.
        if error_rad != 0.0 and (asked_a == wanted_a or asked_a * lack_n_m < 0.0):
            integral += 0.25 * p.loop_1_s * p.period_s * lack_n_m
        is_limited = target_rad != inputs.command_rad or (
            error_rad != 0.0 and (asked_a != wanted_a or abs(wanted_rad_s) == fastest_rad_s)
        )
    wait_s -= h_s

    use = min(abs(inputs.front_use), 1.0)
    rest = 1.0 - use
    trail_m = p.pneumatic_trail_m * rest * rest * rest / (rest + use * use * (1.0 / 3.0))
    road_n_m = -inputs.front_lateral_n * (p.caster_trail_m + trail_m)
    rolled_rad = h_s * road_n_m * p.wheel_damping_1_n_m_s
    damping_n_m_s = 0.0
    if abs(gap_rad) >= p.play_rad and road_n_m * gap_rad >= 0.0:
        damping_n_m_s = p.wheel_damping_n_m_s
    else:
        road_n_m = 0.0

    with_wheels = p.damping_n_m_s + damping_n_m_s
    moment_n_m = asked_a * k + road_n_m
    ohm = p.resistance_ohm * inputs.resistance_factor
    after, bristle_after = moved(
        p.friction, p.inertia_kg_m2, with_wheels, moment_n_m, rate_rad_s, bristle_rad, h_s
    )
    volts = ohm * asked_a + k * after
    if abs(volts) > p.voltage_v_max:
        is_limited = True
        most_v = p.voltage_v_max if volts > 0.0 else -p.voltage_v_max
        moment_n_m = k * most_v / ohm + road_n_m
        with_wheels += k * k / ohm
        after, bristle_after = moved(
            p.friction, p.inertia_kg_m2, with_wheels, moment_n_m, rate_rad_s, bristle_rad, h_s
        )
    turned_rad = h_s * after
    if inputs.rate_share == 0.0:  # stuck
        turned_rad, after = 0.0, 0.0
    elif abs(rack_rad + turned_rad) > p.angle_limit_rad:
        turned_rad = (p.angle_limit_rad if after > 0.0 else -p.angle_limit_rad) - rack_rad
        after = 0.0
    rack_rad += turned_rad
    gap_rad = min(max(gap_rad + rolled_rad - turned_rad, -p.play_rad), p.play_rad)
    seen = rack_rad + inputs.sensor_rad, after, is_limited, rack_rad + gap_rad
    force_n = (road_n_m - damping_n_m_s * after) * p.arm_1_m
    return RackState(*seen, force_n, rack_rad, gap_rad, bristle_after, wait_s, asked_a, integral)
