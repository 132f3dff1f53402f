"""Feedback laws: what the motor of the hand wheel is told each cycle, computed at the wheel.

    rack_force   F = -g f                         the road's force as it arrives, scaled
    spring       F = K i δ                        from the road wheels' angle, in STEERING_STATUS
    model        F = G_n θ                        nominal way from angle to torque: no bus at all
    cdob         F = -g f + d - slow(d)           communication disturbance observer
                 d = Q (G_n θ + g f)              Q = ω_c/(s + ω_c)
    dob          F = -g f + d                     disturbance observer of the wheel
                 d = Q ((J_n s + b_n) s θ + F - T_d)

    F   torque against the angle [N m]            f   RACK_FORCE, to the left positive [N]
    g   so that the nominal front axle, standing still sideways, gives K [N m/N]
    K   torque gradient [N m/rad]                 G_n   ``nominal_road``
    slow   low-pass of the washout: what is slower reaches the hand from the road alone
    T_d    torque of the driver, by the sensor    J_n, b_n   inertia and damping that he is to feel

The discrete observers are those of ``sampled_laws``. To each law come damping and friction of the
motor, and, if asked for, a passivity controller: it counts the energy that the feedback has given
to the wheel, and damps the wheel as soon as it gave more than it took (B. Hannaford and J.-H. Ryu,
Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and Automation
18(1), 2002).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from ..dbc.messages import Message, SteeringForce, SteeringStatus
from .wheel import Row, Rows


class FeedbackParams(NamedTuple):
    """The symbols above, sampled.

    ``a``, ``b``, ``c``  G_n            ``kept``, ``kept_slow``  of Q and of the washout, a cycle
    ``inertia_n_m_rad``, ``damping_n_m_rad``  of the dob, for an angle less its low-pass by Q
    ``friction_n_m``     of the motor, full from a rate of ``friction_rad_s`` on
    ``passive_n_m_s``    largest damping of the passivity controller; 0 for none
    """

    force_n_m_n: float
    spring_n_m_rad: float
    a: Rows
    b: Row
    c: Row
    kept: float
    kept_slow: float
    inertia_n_m_rad: float
    damping_n_m_rad: float
    damping_n_m_s: float
    friction_n_m: float
    friction_rad_s: float
    passive_n_m_s: float
    cycle_s: float


class FeedbackState(NamedTuple):
    """State of G_n, d, slow(d), and the energy that the wheel has given to the feedback [J].

    The dob has the angle's low-pass in the place of the first state of G_n.
    """

    nominal: Row
    observed_n_m: float
    slow_n_m: float
    energy_j: float


class FeedbackInput(NamedTuple):
    """Angle and rate of the hand wheel, force on the rack, angle of the road wheels, and T_d."""

    angle_rad: float
    rate_rad_s: float
    rack_force_n: float
    wheel_rad: float
    driver_torque_n_m: float


Stepped = tuple[FeedbackState, float]
LawStep = Callable[[FeedbackParams, FeedbackState, FeedbackInput], Stepped]


class FeedbackLaw(NamedTuple):
    """A law and the message without which it has nothing to say."""

    step: LawStep
    reads: type[Message] | None


def rack_force_step(p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Return the road's torque as it arrives."""
    return x, -p.force_n_m_n * u.rack_force_n


def spring_step(p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Return the torque of a spring to the middle, which the road wheels stretch."""
    return x, p.spring_n_m_rad * u.wheel_rad


def model_step(p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Return the torque of the nominal road."""
    nominal, observed, slow, energy_j = x
    after = FeedbackState(advanced(p, nominal, u.angle_rad), observed, slow, energy_j)
    return after, dot(p.c, nominal)


def cdob_step(p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Return the road's torque with the model's in place of what is late in it."""
    nominal, observed, slow, energy_j = x
    road_n_m = -p.force_n_m_n * u.rack_force_n
    missing_n_m = dot(p.c, nominal) - road_n_m
    after = FeedbackState(
        advanced(p, nominal, u.angle_rad),
        p.kept * observed + (1.0 - p.kept) * missing_n_m,
        p.kept_slow * slow + (1.0 - p.kept_slow) * observed,
        energy_j,
    )
    return after, road_n_m + observed - slow


def dob_step(p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Return the road's torque with what makes the wheel the nominal one."""
    road_n_m, lag_rad = -p.force_n_m_n * u.rack_force_n, u.angle_rad - x.nominal[0]
    after = FeedbackState(
        (x.nominal[0] + (1.0 - p.kept) * lag_rad, 0.0, 0.0),
        x.observed_n_m
        + p.damping_n_m_rad * lag_rad
        + (1.0 - p.kept) * (road_n_m - u.driver_torque_n_m),
        x.slow_n_m,
        x.energy_j,
    )
    return after, p.inertia_n_m_rad * lag_rad + x.observed_n_m + road_n_m


FEEDBACK_LAWS: Mapping[str, FeedbackLaw] = MappingProxyType(
    {
        "rack_force": FeedbackLaw(rack_force_step, SteeringForce),
        "spring": FeedbackLaw(spring_step, SteeringStatus),
        "model": FeedbackLaw(model_step, None),
        "cdob": FeedbackLaw(cdob_step, SteeringForce),
        "dob": FeedbackLaw(dob_step, SteeringForce),
    }
)


_RACK_FORCE, _SPRING, _MODEL, _CDOB, _ = range(len(FEEDBACK_LAWS))


def feedback_step(law: int, p: FeedbackParams, x: FeedbackState, u: FeedbackInput) -> Stepped:
    """Advance the law at this place of FEEDBACK_LAWS."""
    if law == _RACK_FORCE:
        return rack_force_step(p, x, u)
    if law == _SPRING:
        return spring_step(p, x, u)
    if law == _MODEL:
        return model_step(p, x, u)
    return cdob_step(p, x, u) if law == _CDOB else dob_step(p, x, u)


def resist(p: FeedbackParams, x: FeedbackState, against_n_m: float, rate_rad_s: float) -> Stepped:
    """Return the torque to the left of a law's, with damping, friction and passivity controller."""
    slip = min(max(rate_rad_s / p.friction_rad_s, -1.0), 1.0)
    torque_n_m = -against_n_m - p.damping_n_m_s * rate_rad_s - p.friction_n_m * slip
    if p.passive_n_m_s == 0.0:
        return x, torque_n_m
    energy_j = x.energy_j - torque_n_m * rate_rad_s * p.cycle_s
    squared_s = rate_rad_s * rate_rad_s * p.cycle_s
    if squared_s == 0.0 or energy_j >= 0.0:
        return FeedbackState(x.nominal, x.observed_n_m, x.slow_n_m, energy_j), torque_n_m
    damping_n_m_s = min(-energy_j / squared_s, p.passive_n_m_s)
    torque_n_m = torque_n_m - damping_n_m_s * rate_rad_s
    energy_j = energy_j + damping_n_m_s * squared_s
    return FeedbackState(x.nominal, x.observed_n_m, x.slow_n_m, energy_j), torque_n_m


FEEDBACK_AT_REST = FeedbackState((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def advanced(p: FeedbackParams, nominal: Row, angle_rad: float) -> Row:
    """Return the state of G_n a cycle later."""
    a, b = p.a, p.b
    return (
        dot(a[0], nominal) + b[0] * angle_rad,
        dot(a[1], nominal) + b[1] * angle_rad,
        dot(a[2], nominal) + b[2] * angle_rad,
    )


def dot(left: Row, right: Row) -> float:
    """Return the sum of the products."""
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]
