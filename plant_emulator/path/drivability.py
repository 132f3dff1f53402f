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


def undrivable(path: Path, speed_m_s: float) -> str:
    """Return a warning where even a dry road cannot give what a path asks for, else ""."""
    asked_m_s2 = lateral_acceleration_m_s2(path, speed_m_s)
    if asked_m_s2 <= GRAVITY_M_S2:
        return ""
    return (
        f"the path asks for a lateral acceleration of {asked_m_s2:.3g} m/s² at"
        f" {speed_m_s:.4g} m/s, and a dry road (friction 1) gives {GRAVITY_M_S2:.3g} m/s²: no car"
        " follows it, only the linear model does; drive more slowly or on a gentler path"
    )
