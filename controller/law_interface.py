"""What a law is told at one control tick, and what it answers.

Two clocks run side by side and never need to be compared: the controller counts its control
periods (*tick*), the plant counts its samples (*sample*, by the E2E counter that LATERAL_ERROR and
STEERING_STATUS of one sample share). ``History`` is kept by these numbers, so that a measurement is
used at the time it was taken and a command at the time it was seen to act, however late either
came. All of it is plain floats and integers, in lists live and in arrays in batches.

Most laws use the first two fields only.
"""

from collections.abc import Sequence
from typing import NamedTuple


class VehicleReading(NamedTuple):
    """The newest VEHICLE_STATE; zeros before the first.

    ``is_stale``  whether yaw rate and curvature are too old to be taken for those of now
    """

    speed_m_s: float
    yaw_rate_rad_s: float
    preview_curvature_1_m: float
    is_stale: bool = False


class Link(NamedTuple):
    """How commands and measurements travel, as far as the wire has shown it.

    ``tick``           number of this control period
    ``error_sample``   number of the newest lateral error, -1 before the first
    ``echo_sample``    number of the newest sample with an echo, -1 before the first
    ``delay_ns``       from a tick to the sample, each by its clock, at which its command acts [ns]
    ``is_measured``    whether STEERING_STATUS and VEHICLE_STATE are both fresh
    """

    tick: int
    error_sample: int
    echo_sample: int
    delay_ns: float
    is_measured: bool


class History(NamedTuple):
    """What was sent, by tick, and what was measured, by sample.

    Entry ``number & mask`` belongs to a number: live these are rings, in batches whole runs.

    ``sent_rad``         the command of a tick [rad]
    ``lateral_error_m``  of a sample; not to be read where ``has_error`` is not true
    ``applied_tick``     the tick whose command was in effect at a sample, -1 for none
    ``is_overruled``     whether the steering led the wheel elsewhere at a sample than its command
    ``wheel_rad``        where it was then; not to be read where ``is_overruled`` is not true [rad]
    """

    tick_mask: int
    sample_mask: int
    sent_rad: Sequence[float]
    lateral_error_m: Sequence[float]
    heading_error_rad: Sequence[float]
    has_error: Sequence[bool]
    applied_tick: Sequence[int]
    is_overruled: Sequence[bool]
    wheel_rad: Sequence[float]


NO_VEHICLE = VehicleReading(0.0, 0.0, 0.0)
NO_LINK = Link(0, -1, -1, 0.0, False)
NO_HISTORY = History(0, 0, (0.0,), (0.0,), (0.0,), (False,), (-1,), (False,), (0.0,))


class LawInput(NamedTuple):
    """What a law is told.

    ``lateral_error_m``  the newest measurement [m]
    ``sent_steer_rad``   the command of the previous period as it left, after limits [rad]
    """

    lateral_error_m: float
    sent_steer_rad: float
    vehicle: VehicleReading = NO_VEHICLE
    link: Link = NO_LINK
    history: History = NO_HISTORY


class LawOutput(NamedTuple):
    """What a law decides in one period, and what it believes; what a law lacks stays 0."""

    steer_rad: float  # before limits
    disturbance_rad: float  # d̂ of the DOB
    network_disturbance_rad: float  # d̂_n of the CDOB
    compensated_lateral_error_m: float  # y_fb; the measured error where there is no CDOB
