"""Printed results of SAE 2018-01-1086: Table II, and the text on figures 16 to 24.

Nothing here is computed. The paper shows the runs themselves only as pictures: its text gives
neither the axes of the ellipse, nor the duration, nor a value of any curve.
"""

from typing import NamedTuple


class Table2Column(NamedTuple):
    """One column of Table II: a corner of the uncertainty box, and the RMS tracking errors [m].

    ``corner``  letter of the corner; the text does not assign the letters, these follow the
                columns
    """

    corner: str
    speed_km_h: float
    virtual_mass_kg: float
    pd_m: float
    pd_dob_m: float


TABLE_2 = (
    Table2Column("a", 4.0, 1600.0, 0.0580, 0.0320),
    Table2Column("b", 4.0, 5000.0, 0.0581, 0.0336),
    Table2Column("c", 7.0, 1600.0, 0.0523, 0.0359),
    Table2Column("d", 7.0, 5000.0, 0.0526, 0.0370),
)

REAR_CORNERING_STIFFNESS_N_RAD = 50_000.0
"""C_r as Table I prints it."""

FIGURES_16_TO_20 = "with DOB the path following error decreases obviously (section VIII)"
TABLE_2_CLAIM = "the smaller errors in the presence of disturbance observer (section VIII)"
FIGURE_20 = "external disturbance is added due to road curvature input (section VIII)"
FIGURE_21 = "CDOB has reduced errors (section VIII)"
FIGURE_22 = "CDOB has smaller steering angle than PD only (section VIII)"
FIGURE_23 = "DDOB works better than CDOB with reduced path following errors (section VIII)"
FIGURE_24_STEER = "both systems have similar steering angle (section VIII)"
