"""Wheel on a spring that answers late: the smallest feedback loop, solved in closed form.

    J θ'' + b θ' + K θ(t - τ) = 0

    J   inertia_kg_m2    of the hand wheel and of what holds it          [kg m²]
    b   damping_n_m_s    of both                                         [N m s/rad]
    K   stiffness_n_m    torque gradient that the bus brings back late   [N m/rad]
    τ   round trip: from the wheel's angle to the torque that answers it [s]

The loop is stable up to the first τ with a root s = jω. There |K/(jω (b + jω J))| = 1, hence

    ω² = (sqrt(b⁴ + 4 J² K²) - b²)/(2 J²)        τ = (π/2 - atan(ω J/b))/ω

and beyond it the loop stays unstable. It is passive, thus stable in every hand that is passive
too, for τ ≤ b/K (J. E. Colgate and G. Schenkel, Passivity of a class of sampled-data systems,
Journal of Robotic Systems 14(1), 1997, without their half period of the hold).
"""

from math import atan2, isfinite, pi, sqrt
from typing import NamedTuple

from ...runtime.settings import SettingsError


class FeedbackStability(NamedTuple):
    """Round trips that the wheel alone bears.

    ``stable_delay_s``   longest stable round trip [s]
    ``passive_delay_s``  longest passive round trip [s]
    ``shakes_at_hz``     frequency at which it shakes at the longest stable one [Hz]
    """

    stable_delay_s: float
    passive_delay_s: float
    shakes_at_hz: float


def feedback_stability(
    *, inertia_kg_m2: float, damping_n_m_s: float, stiffness_n_m: float
) -> FeedbackStability:
    """Return the round trips that a wheel with a delayed spring bears, exactly.

    Raises SettingsError where inertia or stiffness is not positive, or the damping is negative.

    >>> stability = feedback_stability(inertia_kg_m2=0.04, damping_n_m_s=0.2, stiffness_n_m=2.0)
    >>> f"{stability.stable_delay_s:.3f} s, passive to {stability.passive_delay_s:.3f} s"
    '0.108 s, passive to 0.100 s'
    """
    for name, value, may_be_zero in (
        ("inertia_kg_m2", inertia_kg_m2, False),
        ("damping_n_m_s", damping_n_m_s, True),
        ("stiffness_n_m", stiffness_n_m, False),
    ):
        if not isfinite(value) or value < 0.0 or (value == 0.0 and not may_be_zero):
            least = "0 or more" if may_be_zero else "more than 0"
            raise SettingsError(f"{name} = {value!r} must be a finite number, {least}")
    # ω² as a quotient, which loses no digits where b² is much larger than J K.
    squared = damping_n_m_s * damping_n_m_s
    root = sqrt(squared * squared + (2.0 * inertia_kg_m2 * stiffness_n_m) ** 2)
    omega_rad_s = stiffness_n_m * sqrt(2.0 / (root + squared))
    margin_rad = atan2(damping_n_m_s, omega_rad_s * inertia_kg_m2)
    return FeedbackStability(
        margin_rad / omega_rad_s, damping_n_m_s / stiffness_n_m, omega_rad_s / (2.0 * pi)
    )
