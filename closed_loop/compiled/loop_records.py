"""Records that a compiled run reads, keeps and leaves, of ``closed_loop.compiled.loop``."""

from typing import Any, NamedTuple

import numpy as np

from ...controller.history.history import (
    NO_COMMANDS,
    NO_ECHOES,
    NO_ERRORS,
    NO_YAW_RATES,
    Commands,
    Echoes,
    Errors,
    HistoryParams,
    YawRates,
)
from ...controller.law_interface import History, LoopDelay, VehicleReading
from ...controller.limits.steer_limits import SteerLimits
from ...plant_emulator.steering.hold_and_fallback import GuardParams, GuardState
from ...runtime.array_types import FloatArray, IntArray


class Constants(NamedTuple):
    """Numbers of a run.

    ``ramp_step_rad``     of SAFE_STOP and of the fade after a recovery, per control period
    ``motion_start_ns``   when the vehicle starts to move
    ``share``             of its steer that the law may ask for at this speed
    ``share_from_ns``     when the controller first knows the speed
    ``speed_m_s``         that the controller knows, 0 for none; share and params are those for it
    ``alike_to_m_s``      up to which speed they stay the same; infinite where the speed is constant
    ``stop_m_s2``         braking of the steering's fallback, 0 for none
    """

    guard: GuardParams
    limits: SteerLimits
    ramp_step_rad: float
    motion_start_ns: int
    share: float
    share_from_ns: int
    speed_m_s: float
    alike_to_m_s: float
    stop_m_s2: float


TICK_NS, TICK_SAMPLE = range(2)
DUE_NS, SENT_AT = range(2)
STATE_SAMPLE, STATE_IS_STALE, STATUS_SAMPLE = range(3)


class Instants(NamedTuple):
    """When everything happens, in ns; independent of how the vehicle moves.

    ``ticks``      (2, ticks): the control ticks from the first command on, and the sample whose
                   measurement is in use at each
    ``commands``   (2, commands): when each that comes through reaches the actuator, in order, and
                   which tick it was sent at
    ``sample_ns``  when the sensors sample
    ``noise_m``    the sensor noise of each sample's lateral error
    ``in_use``     (3, ticks): the sample whose VEHICLE_STATE is in use at each tick, -1 for none,
                   whether it is stale, and the sample of the STEERING_STATUS in use; or (0, 0): not
                   needed, since the speed is constant and the law does not read the message; or
                   without the last row: not needed unless the steering overrules a command
    """

    ticks: IntArray
    commands: IntArray
    sample_ns: IntArray
    noise_m: FloatArray
    in_use: IntArray


WAITING = 4096
"""A power of two; more than the commands and plan values of a second."""
ERROR, HEADING, YAW_RATE, WHEEL, CURVATURE, ARC_LENGTH, SPEED, MEASURED, OVERRULED = range(9)
TYRES = 9
SENT, LAW_OUTPUT = 0, 1


class Waiting(NamedTuple):
    """Rings of WAITING: when each command is due in the motion, and its steer."""

    due_ns: IntArray
    steer_rad: FloatArray


class Records(NamedTuple):
    """The records of a run: few arrays, because every function that gets them takes them apart.

    ``samples``     (9, samples), SI, from ERROR to the measured error as on the wire and OVERRULED:
                    the wheel angle as on the wire where the steering overrules, else NaN; it is
                    written only where ``Instants.in_use`` has a status. Of a car five more, from
                    TYRES on: ``car_motion.Tyres``
    ``command``     index into the schedule's commands of the one in effect at each sample, -1
                    before the first
    ``ticks``       (5, ticks): the command sent, and from row LAW_OUTPUT on ``LawOutput``
    ``waiting``     commands that wait for the actuator's dead time; None without one
    """

    samples: FloatArray
    command: IntArray
    ticks: FloatArray
    waiting: Waiting | None


def empty_records(samples: int, ticks: int, *, has_dead_time: bool, is_car: bool) -> Records:
    """Return empty records: errors and commands are NaN at first, the others uninitialised."""
    of_samples, of_ticks = np.empty((TYRES + 5 * is_car, samples)), np.empty((5, ticks))
    of_samples[ERROR] = of_samples[OVERRULED] = of_ticks[SENT] = np.nan
    waiting = Waiting(np.empty(WAITING, np.int64), np.empty(WAITING)) if has_dead_time else None
    return Records(of_samples, np.empty(samples, np.int64), of_ticks, waiting)


ARRIVED_NS, MESSAGE, OF_SAMPLE = range(3)
SEEN_HEADING, SEEN_YAW_RATE, SEEN_CURVATURE, SEEN_WHEEL, SEEN_SPEED = range(5)


class Inbox(NamedTuple):
    """The controller's input, for a law that looks back.

    ``arrivals``        (3, arrivals): when each message that the controller accepts arrives, which
                        ``Uplink`` it is, and of which sample; in order of arrival
    ``noise``           (2, samples): of heading and yaw rate
    ``signals``         (5, samples): heading, yaw rate and more as the bus carries them; written
                        during the run, as the rest
    ``status``          code of STEERING_STATUS at each sample, with APPLYING for LIMITED
    ``buffer``          the plan that the plant plays, as the bus carries it: values of its row
    ``played_rad``      what a plan has let act at a sample, else NaN
    ``path_ahead_1_m``  values of each PATH_AHEAD, as on the wire; one of every ``samples_per_path``
    ``first_tick``      of the first command, from which the history counts
    """

    params: HistoryParams
    rings: History
    arrivals: IntArray
    noise: FloatArray
    signals: FloatArray
    status: IntArray
    periods_per_sample: float
    buffer: FloatArray
    played_rad: FloatArray
    samples_per_path: int
    path_spacing_m: float
    path_ahead_1_m: FloatArray
    first_tick: int


class Known(NamedTuple):
    """What the controller has received.

    ``arrivals``    messages that have arrived so far
    ``vehicle_*``   sample and arrival of the newest VEHICLE_STATE, -1 for none
    ``path_end``    as in ``LoopDelay``
    """

    arrivals: int
    errors: Errors
    echoes: Echoes
    yaw_rates: YawRates
    commands: Commands
    vehicle_sample: int
    vehicle_ns: int
    path_end: int


class Now(NamedTuple):
    """What the controller knows at a tick, besides errors and commands."""

    vehicle: VehicleReading
    loop_delay: LoopDelay


NOW_UNKNOWN = Now(VehicleReading(0.0, 0.0, 0.0, False), LoopDelay(0, -1, -1, 0.0, False, -1, -1))
NOTHING_KNOWN = Known(0, NO_ERRORS, NO_ECHOES, NO_YAW_RATES, NO_COMMANDS, -1, -1, -1)


class Progress(NamedTuple):
    """State of the plant: its motion, the steering's guard, the next sample to take, the next
    command to arrive, and the one in effect.

    ``followed_ns``  when the wheel was last within its tolerance
    ``plan``         the command that has brought the plan in the buffer, -1 for none
    ``is_new``       whether no value of it has been played yet
    ``played``       the newest sample for which a value was played
    ``given``        commands given to the actuator, and how many of them act
    ``hands``        of a hand wheel (``WheelProgress``), None without one
    """

    motion: Any
    guard: GuardState
    followed_ns: int
    sample: int
    command: int
    in_effect: int
    plan: int
    is_new: bool
    played: int
    given: int
    acting: int
    hands: Any


class Kept(NamedTuple):
    """What stays from segment to segment, besides the law's state: the plant, the command last
    sent, the rest of the fade [rad], and what the controller has received; None for a law that
    does not look back.
    """

    plant: Progress
    sent_rad: float
    fade_rad: float
    known: Any


class Segment(NamedTuple):
    """Ticks that the controller spends in one mode, as ``range(first_tick, last_tick)``.

    ``is_recovery``  whether the law has just restarted while a command was being held
    """

    mode: int
    first_tick: int
    last_tick: int
    is_recovery: bool


def rms_of(values: FloatArray) -> float:
    """Return the root mean square, added up in the order of the samples; 0 without any."""
    squares = np.cumsum(np.square(values))
    return float(np.sqrt(squares[-1] / len(squares))) if len(squares) else 0.0
