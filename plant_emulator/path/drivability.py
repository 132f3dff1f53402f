"""Drivability of a path: a bend needs a lateral acceleration that friction has to give.

    ρ V² ≤ μ g

    ρ   largest curvature of the path   [1/m]        V   speed     [m/s]
    μ   friction coefficient            [1]          g   gravity   [m/s²]

The single-track model is linear and follows any bend, so only this check tells.
"""

from .path import Path

GRAVITY_M_S2 = 9.80665


def lateral_acceleration_m_s2(path: Path, speed_m_s: float) -> float:
    """Return the largest lateral acceleration that a path asks for at a speed."""
    # Curvature is linear between break points.
    return max(map(abs, path.curvature_1_m)) * speed_m_s**2


def undrivable(path: Path, speed_m_s: float, friction: float = 1.0, *, is_car: bool = False) -> str:
    """Return a warning where not even this friction gives what a path asks for, else ""."""
    asked_m_s2 = lateral_acceleration_m_s2(path, speed_m_s)
    given_m_s2 = friction * GRAVITY_M_S2
    if asked_m_s2 <= given_m_s2:
        return ""
    road = f"its tyres (friction {friction:g}) give" if is_car else "a dry road (friction 1) gives"
    then = (
        "at that speed the car slides"
        if is_car
        else "no car follows it, only the linear model does"
    )
    return (
        f"the path asks for a lateral acceleration of {asked_m_s2:.3g} m/s² at"
        f" {speed_m_s:.4g} m/s, and {road} {given_m_s2:.3g} m/s²: {then};"
        " drive more slowly or on a gentler path"
    )
