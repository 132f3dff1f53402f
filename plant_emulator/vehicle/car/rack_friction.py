"""Friction of the rack: Coulomb's, which sticks exactly, or LuGre's with bristles.

    Coulomb   M = M_c sign ω;  at rest as much of M_c as holds the rack
    LuGre     M = σ0 z + σ1 ż,   ż = ω − σ0 |ω| z/g(ω),   g = M_c + (M_s − M_c) e^(−(ω/ω_s)²)

    ω      rate of the rack [rad/s]          z    deflection of the bristles [rad]
    M_c    Coulomb friction [N m]            M_s  static friction [N m]
    σ0, σ1 stiffness and damping of the bristles [N m/rad, N m s/rad]     ω_s  Stribeck's [rad/s]

LuGre: Canudas de Wit, Olsson, Åström and Lischinsky, A new model for control of systems with
friction, IEEE Trans. Automatic Control 40 (1995). Viscous friction, their σ2, is the rack's own. It
creates no energy if σ2 >= σ1 (M_s − M_c)/M_c (Barabanov and Ortega, IEEE TAC 45, 2000).

The exponential is 1/(1 + q + q²/2 + q³/6 + q⁴/24)¹⁶ with q = (ω/ω_s)²/16, at most 2e-6 off, so
every processor gives the same bits.
"""

from typing import NamedTuple


class FrictionParams(NamedTuple):
    """The symbols above; ``bristle_n_m`` is σ0, 0 for Coulomb's, and ``bristle_n_m_s`` σ1."""

    coulomb_n_m: float
    static_n_m: float
    bristle_n_m: float
    bristle_n_m_s: float
    stribeck_rad_s: float


def moved(
    p: FrictionParams,
    inertia_kg_m2: float,
    damping_n_m_s: float,
    moment_n_m: float,
    rate_rad_s: float,
    bristle_rad: float,
    h_s: float,
) -> tuple[float, float]:
    """Return rate and deflection after ``h_s``, of an inertia under a moment.

    Implicit in the rate, so it is stable however stiff the bristles are.
    """
    momentum = inertia_kg_m2 * rate_rad_s + h_s * moment_n_m
    if p.bristle_n_m == 0.0:
        held = h_s * p.coulomb_n_m
        if -held <= momentum <= held:
            return 0.0, 0.0
        momentum -= held if momentum > 0.0 else -held
        return momentum / (inertia_kg_m2 + h_s * damping_n_m_s), 0.0
    yielding = 1.0 / (1.0 + h_s * abs(rate_rad_s) * p.bristle_n_m / steady_n_m(p, rate_rad_s))
    kept_rad = bristle_rad * yielding
    held = h_s * p.bristle_n_m * kept_rad + p.bristle_n_m_s * (kept_rad - bristle_rad)
    slope_n_m_s = (p.bristle_n_m * h_s + p.bristle_n_m_s) * yielding
    after = (momentum - held) / (inertia_kg_m2 + h_s * (damping_n_m_s + slope_n_m_s))
    return after, kept_rad + h_s * after * yielding


def steady_n_m(p: FrictionParams, rate_rad_s: float) -> float:
    """Return g(ω)."""
    ratio = rate_rad_s / p.stribeck_rad_s
    q = ratio * ratio * (1.0 / 16.0)
    if q > 1.0:
        return p.coulomb_n_m
    power = 1.0 + q * (1.0 + q * (0.5 + q * (1.0 / 6.0 + q * (1.0 / 24.0))))
    power *= power
    power *= power
    power *= power
    return p.coulomb_n_m + (p.static_n_m - p.coulomb_n_m) / (power * power)
