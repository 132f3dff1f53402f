"""Proportional-derivative controller of SAE 2018-01-1086, with the derivative filter it leaves out.

c = -C(s) y_fb,   C(s) = K_p + K_d s/(s/N + 1)       N → ∞ (no filter) in paper

y_fb  compensated_lateral_error_m   error fed back; the path is the reference 0      [m]
c     steer_rad                     steering demand                                  [rad]
"""

from typing import NamedTuple

from .sections import Section, SectionState, section_at_rest, section_step


class PdParams(NamedTuple):
    """C(z) as one section."""

    compensator: Section


def pd_step(
    p: PdParams, x: SectionState, compensated_lateral_error_m: float
) -> tuple[SectionState, float]:
    """Advance one control period; returns the new state and the demand c [rad]."""
    x_next, demand_rad = section_step(p.compensator, x, compensated_lateral_error_m)
    return x_next, -demand_rad


def pd_at_rest(p: PdParams, lateral_error_m: float) -> SectionState:
    """Return the state after a constant lateral error [m]."""
    return section_at_rest(p.compensator, lateral_error_m)[0]
