"""Interface of a law: its input and output at one control tick, and the record that describes it.

A law is one module that ends with its record, and ``controller.laws`` finds the module. Settings,
node, ``--check`` and compiled runs use only the record.

There are two clocks, which never need to be compared. The controller counts its control periods
(*tick*). The plant counts its samples (*sample*, by the E2E counter that LATERAL_ERROR and
STEERING_STATUS of one sample share). ``History`` is indexed by these numbers. A measurement is
therefore used at the time it was taken, and a command at the time it took effect, however late the
frames arrived. All values are plain floats and integers: lists in a live run, arrays in batches.

Most laws use only the first two fields of ``LawInput``.
"""

from collections.abc import Callable, MutableSequence, Sequence
from typing import Any, NamedTuple

from ..dbc.messages import LawNumber
from ..runtime.settings import Settings


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
    ``settled_sample`` up to which sample all that the filter uses has come, or is lost
    """

    tick: int
    error_sample: int
    echo_sample: int
    delay_ns: float
    is_measured: bool
    path_end: int = -1
    settled_sample: int = -1


_NONE: Any = ()


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
    ``command_tick``     the tick that sent a command, by the command's number
    ``yaw_rate_rad_s``   of the sample ``yaw_rate_sample``, which may be an earlier one [rad/s]
    """

    tick_mask: int
    sample_mask: int
    sent_rad: MutableSequence[float]
    lateral_error_m: MutableSequence[float]
    heading_error_rad: MutableSequence[float]
    has_error: MutableSequence[bool]
    applied_tick: MutableSequence[int]
    is_overruled: MutableSequence[bool]
    wheel_rad: MutableSequence[float]
    curvature_1_m: MutableSequence[float] = _NONE
    plan_mask: int = 0
    plans: Sequence[MutableSequence[float]] = ()
    command_tick: MutableSequence[int] = _NONE
    yaw_rate_rad_s: MutableSequence[float] = _NONE
    yaw_rate_sample: MutableSequence[int] = _NONE


def newest_heading_rad(observed: "LawInput") -> float:
    """Return the heading error of the newest lateral error [rad]; 0 without a history."""
    history = observed.history
    return history.heading_error_rad[observed.loop_delay.error_sample & history.sample_mask]


NO_VEHICLE = VehicleReading(0.0, 0.0, 0.0)
NO_LOOP_DELAY = LoopDelay(0, -1, -1, 0.0, False)
_NO_VALUES: Any = (0.0,), (0.0,), (0.0,), (False,), (-1,), (False,), (0.0,)
"""Tuples, which compiled laws can take."""
NO_HISTORY = History(0, 0, *_NO_VALUES)


class LawInput(NamedTuple):
    """Input of a law.

    ``lateral_error_m``  the newest measurement [m]
    ``sent_steer_rad``   the command sent in the previous period, after limits; the wheel's
                         angle while the steering reports that it limits it or has fallen back [rad]
    """

    lateral_error_m: float
    sent_steer_rad: float
    vehicle: VehicleReading = NO_VEHICLE
    loop_delay: LoopDelay = NO_LOOP_DELAY
    history: History = NO_HISTORY


class LawOutput(NamedTuple):
    """Command and internal estimates of a law in one period; estimates a law lacks stay 0."""

    steer_rad: float  # before limits
    disturbance_rad: float  # d̂ of the DOB
    network_disturbance_rad: float  # d̂_n of the CDOB
    compensated_lateral_error_m: float  # y_fb; the measured error where there is no CDOB


LawStep = Callable[[Any, Any, LawInput], tuple[Any, LawOutput]]
LawPlan = Callable[[Any, Any, LawInput], int]


class VehicleBelief(NamedTuple):
    """Steering lag [s] and virtual mass [kg] of the model that a law steers by now."""

    steering_lag_s: float
    virtual_mass_kg: float


class Schedule(NamedTuple):
    """Params of a law that depend on the speed; ``at`` returns them for a speed [m/s]."""

    at: Callable[[float], Any]


class Fallback(NamedTuple):
    """The law that takes over from another one, and a text that describes when."""

    law: str
    when: str


class LookingBack(NamedTuple):
    """How ``--check`` analyses a law that is linear only while the latency is constant.

    ``opening``, ``closing``  lines before and after the analysis
    """

    opening: tuple[str, ...]
    closing: tuple[str, ...] = ()
    fallback: Fallback | None = None


class Law(NamedTuple):
    """A law; ``Any`` stands for its own params and state, both NamedTuples of numbers, and for the
    settings, ``controller.laws.settings.LawSettings``, which contain the law.

    ``step``      ``step(params, state, LawInput) -> (state, LawOutput)``: one control period
    ``at_rest``   state after a constant lateral error [m] and no steering, from the params
    ``design``    params from the settings; a ``Schedule`` where they depend on the speed
    ``number``    its code on the bus
    ``settings``  model of the law's own table, which is named after the law
    ``needs``     other tables that the law requires
    ``schedules_demand`` whether its gains follow the speed beyond [validity] too
    ``needs_vehicle``    whether [nominal_model] has to be of kind 'vehicle'
    ``cutoffs``          keys of its own table that have to be below the Nyquist frequency
    ``looks_back``       whether the law reads more than the first two fields of its ``LawInput``;
                         if not, no history of the bus is kept
    ``feed_forward_refusal``  why [feed_forward] must not be added; empty: it may be
    ``commands_read``    for a law that is linear in the lateral error and its own last commands:
                         returns the number of these commands from the params; None: not linear
    ``heading_gain``     for a law that is linear in the newest heading error too: returns its gain
                         [rad/rad] from the params; the law looks back where that is not 0
    ``looking_back``     analysis of a law that is linear at a constant latency only
    ``after_hold``       state after a hold, from the params, the state before the hold and the
                         lateral error now [m]; None: the law starts again
    ``plan``             for a law that plans: writes the plan of this period into the history's
                         ``plans``, from the params, the state after the step and its input, and
                         returns the index of the value that acts first, -1 for no plan
    ``believes``         of a law that steers by a model of the vehicle: that model, from the
                         settings and the state
    ``asks_speed``       of a law that may ask to slow down: from the settings, a function from the
                         state to the speed not to be exceeded [m/s]; None: these never ask
    ``single_commands``  the law in place of one that plans, on classic CAN
    """

    step: LawStep
    at_rest: Callable[[Any, float], Any]
    design: Callable[[Any], Any]
    number: LawNumber = LawNumber.CUSTOM
    settings: type[Settings] | None = None
    needs: tuple[str, ...] = ()
    schedules_demand: bool = False
    needs_vehicle: bool = False
    cutoffs: tuple[str, ...] = ()
    looks_back: bool = False
    feed_forward_refusal: str = ""
    commands_read: Callable[[Any], int] | None = None
    heading_gain: Callable[[Any], float] | None = None
    looking_back: Callable[[Any, Any], LookingBack | None] | None = None
    after_hold: Callable[[Any, Any, float], Any] | None = None
    plan: LawPlan | None = None
    believes: Callable[[Any, Any], VehicleBelief] | None = None
    asks_speed: Callable[[Any], Callable[[Any], float] | None] | None = None
    single_commands: str = ""


def last_command(_params: Any) -> int:
    """Return the number of commands that a law reads if it reads ``sent_steer_rad`` only."""
    return 1
