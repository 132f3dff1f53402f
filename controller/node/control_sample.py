"""The controller's values in one period, for plots."""

from typing import NamedTuple

from ...dbc.messages import Mode
from ..interface.law import LawOutput


class ControlSample(NamedTuple):
    """One control period with a command, for plots.

    ``time_ns``          when the tick ran [ns]
    ``lateral_error_m``  the newest measurement [m]
    ``sample_age_ns``    time since that measurement arrived [ns]
    ``law_output``       of this period; the last one while the mode is not ACTIVE
    ``sent_steer_rad``   the command, after limits [rad]
    """

    time_ns: int
    mode: Mode
    lateral_error_m: float
    sample_age_ns: int
    law_output: LawOutput
    sent_steer_rad: float
