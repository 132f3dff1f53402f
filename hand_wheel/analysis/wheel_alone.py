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

from math import atan2, pi, sqrt
from typing import NamedTuple

from pydantic import Field

from ...runtime.settings import Settings


class FeedbackStability(NamedTuple):
    """Round trips that the wheel alone bears.

    ``stable_delay_s``   longest stable round trip [s]
    ``passive_delay_s``  longest passive round trip [s]
    ``shakes_at_hz``     frequency at which it shakes at the longest stable one [Hz]
    """

    stable_delay_s: float
    passive_delay_s: float
    shakes_at_hz: float


class LateSpring(Settings):
    """The wheel, in ranges that no real one leaves."""

    inertia_kg_m2: float = Field(ge=1e-6, le=1e6)
    damping_n_m_s: float = Field(ge=0.0, le=1e6)
    stiffness_n_m: float = Field(ge=1e-6, le=1e6)


def feedback_stability(
    *, inertia_kg_m2: float, damping_n_m_s: float, stiffness_n_m: float
) -> FeedbackStability:
    """Return the round trips that a wheel with a delayed spring bears, exactly.

    Raises SettingsError for a value that is not in the range of LateSpring.

    >>> stability = feedback_stability(inertia_kg_m2=0.04, damping_n_m_s=0.2, stiffness_n_m=2.0)
    >>> f"{stability.stable_delay_s:.3f} s, passive to {stability.passive_delay_s:.3f} s"
    '0.108 s, passive to 0.100 s'
    """
    wheel = LateSpring(
        inertia_kg_m2=inertia_kg_m2, damping_n_m_s=damping_n_m_s, stiffness_n_m=stiffness_n_m
    )
    inertia, damping, stiffness = wheel.inertia_kg_m2, wheel.damping_n_m_s, wheel.stiffness_n_m
    # ω² as a quotient, which loses no digits where b² is much larger than J K.
    squared = damping * damping
    root = sqrt(squared * squared + (2.0 * inertia * stiffness) ** 2)
    omega_rad_s = stiffness * sqrt(2.0 / (root + squared))
    margin_rad = atan2(damping, omega_rad_s * inertia)
    return FeedbackStability(
        margin_rad / omega_rad_s, damping / stiffness, omega_rad_s / (2.0 * pi)
    )
