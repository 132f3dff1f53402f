"""Input and output of a law at one control tick.

There are two clocks, which never need to be compared. The controller counts its control periods
(*tick*). The plant counts its samples (*sample*, by the E2E counter that LATERAL_ERROR and
STEERING_STATUS of one sample share). ``History`` is indexed by these numbers. A measurement is
therefore used at the time it was taken, and a command at the time it took effect, however late the
frames arrived. All values are plain floats and integers: lists in a live run, arrays in batches.

Most laws use only the first two fields of ``LawInput``.
"""

from collections.abc import MutableSequence, Sequence
from typing import NamedTuple


class VehicleReading(NamedTuple):
    """The newest VEHICLE_STATE; zeros before the first.

    ``is_stale``  whether yaw rate and curvature are too old to be used
    """

    speed_m_s: float
    yaw_rate_rad_s: float
    preview_curvature_1_m: float
    is_stale: bool = False


class LoopDelay(NamedTuple):
    """Transmission of commands and measurements, as observed on the bus.

    ``tick``           number of this control period
    ``error_sample``   number of the newest lateral error, -1 before the first
    ``echo_sample``    number of the newest sample with an echo, -1 before the first
    ``delay_ns``       from a tick to the sample at which its command acts, each by its clock [ns]
    ``path_end``       up to which sample the path's curvature is known, -1 for none
    ``is_measured``    whether STEERING_STATUS and VEHICLE_STATE are both fresh
    """

    tick: int
    error_sample: int
    echo_sample: int
    delay_ns: float
    is_measured: bool
    path_end: int = -1


class History(NamedTuple):
    """Sent commands by tick, and measurements by sample.

    The value of a number is at index ``number & mask``. In a live run the arrays are rings; in
    batches they hold the whole run.

    ``sent_rad``         the command of a tick [rad]
    ``lateral_error_m``  of a sample; valid only where ``has_error`` is true [m]
    ``applied_tick``     the tick whose command was in effect at a sample, -1 for none
    ``is_overruled``     whether the steering overruled the command at a sample
    ``wheel_rad``        wheel angle at that sample [rad]
    ``curvature_1_m``    of the path at the preview point of a sample, past or to come; valid up to
                         ``LoopDelay.path_end``
    ``plans``            of a law that plans, by tick: rows of ``controller.history.plan``; its mask
                         is 0 for a law that does not
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
    curvature_1_m: Sequence[float] = ()
    plan_mask: int = 0
    plans: Sequence[MutableSequence[float]] = ()


NO_VEHICLE = VehicleReading(0.0, 0.0, 0.0)
NO_LOOP_DELAY = LoopDelay(0, -1, -1, 0.0, False)
NO_HISTORY = History(0, 0, (0.0,), (0.0,), (0.0,), (False,), (-1,), (False,), (0.0,))


class LawInput(NamedTuple):
    """Input of a law.

    ``lateral_error_m``  the newest measurement [m]
    ``sent_steer_rad``   the command sent in the previous period, after limits [rad]
    """

    lateral_error_m: float
    sent_steer_rad: float
    vehicle: VehicleReading = NO_VEHICLE
    link: LoopDelay = NO_LOOP_DELAY
    history: History = NO_HISTORY


class LawOutput(NamedTuple):
    """Command and internal estimates of a law in one period; estimates a law lacks stay 0."""

    steer_rad: float  # before limits
    disturbance_rad: float  # d̂ of the DOB
    network_disturbance_rad: float  # d̂_n of the CDOB
    compensated_lateral_error_m: float  # y_fb; the measured error where there is no CDOB
