"""Uncertainty box: a nominal vehicle and the ranges of those of its parameters that are unknown.

The paper's box (Figure 2) is V ∈ [4, 7] km/h by m̃ = m/μ ∈ [1600, 5000] kg.
"""

from itertools import product
from typing import NamedTuple

from ...controller.filters.nominal_model import NominalVehicle


class ParameterRange(NamedTuple):
    """One side of the box: a field of ``NominalVehicle`` and its bounds, in that field's unit."""

    field: str
    minimum: float
    maximum: float


class UncertaintyBox(NamedTuple):
    """All vehicles between the bounds; parameters without a range are those of ``nominal``."""

    nominal: NominalVehicle
    ranges: tuple[ParameterRange, ...]

    def vertices(self) -> tuple[NominalVehicle, ...]:
        """Return the 2^n corners, the last range changing first.

        With speed before virtual mass: slow and light, slow and heavy, fast and light, fast and
        heavy; these are the corners a, b, c and d of the presets.
        """
        return self.grid(2)

    def grid(self, points: int) -> tuple[NominalVehicle, ...]:
        """Return points^n vehicles evenly spread from bound to bound, points ≥ 2."""
        axes = [
            [r.minimum + (r.maximum - r.minimum) * i / (points - 1) for i in range(points)]
            for r in self.ranges
        ]
        fields = [r.field for r in self.ranges]
        return tuple(
            self.nominal._replace(**dict(zip(fields, values, strict=True)))
            for values in product(*axes)
        )


def paper_box(rear_cornering_stiffness_n_rad: float = 500e3) -> UncertaintyBox:
    """Return Figure 2's box around the vehicle of (19); Table I prints C_r = 50,000."""
    nominal = NominalVehicle(
        virtual_mass_kg=2000.0,
        yaw_inertia_kg_m2=3728.0,
        front_cornering_stiffness_n_rad=190e3,
        rear_cornering_stiffness_n_rad=rear_cornering_stiffness_n_rad,
        front_axle_distance_m=1.3008,
        rear_axle_distance_m=1.5453,
        preview_distance_m=2.0,
        speed_m_s=5.0 / 3.6,
    )
    return UncertaintyBox(
        nominal,
        (
            ParameterRange("speed_m_s", 4.0 / 3.6, 7.0 / 3.6),
            ParameterRange("virtual_mass_kg", 1600.0, 5000.0),
        ),
    )
