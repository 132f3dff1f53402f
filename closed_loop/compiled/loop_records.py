"""Records that a compiled run reads, keeps and leaves, of ``closed_loop.compiled.loop``."""

from typing import Any, NamedTuple

import numpy as np

from ...controller.limits.steer_limits import SteerLimits
from ...plant_emulator.steering.hold_and_fallback import GuardParams, GuardState
from ...runtime.array_types import FloatArray, IntArray
from .law_input import Known


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


class Instants(NamedTuple):
    """When everything happens, in ns; independent of how the vehicle moves.

    ``tick_ns``         control ticks from the first command on
    ``tick_sample``     the sample whose measurement is in use at each tick
    ``command_due_ns``  when each command that comes through reaches the actuator, in order
    ``command_tick``    which tick it was sent at
    ``sample_ns``       when the sensors sample
    ``noise_m``         the sensor noise of each sample's lateral error
    ``tick_status``     the sample whose STEERING_STATUS is in use at each tick, -1 for none; empty:
                        not needed unless the steering overrules a command
    ``tick_state``      the sample whose VEHICLE_STATE is in use at each tick, -1 for none; empty:
                        the speed is constant, and the law does not read the message
    ``tick_is_stale``   whether that one is stale
    """

    tick_ns: IntArray
    tick_sample: IntArray
    command_due_ns: IntArray
    command_tick: IntArray
    sample_ns: IntArray
    noise_m: FloatArray
    tick_status: IntArray
    tick_state: IntArray
    tick_is_stale: IntArray


WAITING = 4096
"""A power of two; more than the commands and plan values of a second."""


class Records(NamedTuple):
    """The records of a run: the first ten per sample, the next two per control tick.

    ``overruled_rad``  wheel angle as on the wire where the steering overrules, else NaN; written
                    only where ``Instants.tick_status`` is there
    ``command``     index into the schedule's commands of the one in effect, -1 before the first
    ``law_output``  (ticks, 4), in the order of ``LawOutput``
    ``waiting_ns``, ``waiting_rad``  rings of WAITING: commands that wait for the actuator's dead
                    time, and when each is due in the motion
    """

    lateral_error_m: FloatArray
    heading_error_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    wheel_angle_rad: FloatArray
    curvature_1_m: FloatArray
    arc_length_m: FloatArray
    speed_m_s: FloatArray
    measured_m: FloatArray
    command: IntArray
    overruled_rad: FloatArray
    sent_rad: FloatArray
    law_output: FloatArray
    waiting_ns: IntArray
    waiting_rad: FloatArray


def empty_records(samples: int, ticks: int, speed_m_s: float) -> Records:
    """Return empty records: errors and commands are NaN at first, the others uninitialised.

    ``speed_m_s``  of a linear vehicle, whose place and speed the loop does not record
    """
    return Records(
        np.full(samples, np.nan),
        np.empty(samples),
        np.empty(samples),
        np.empty(samples),
        np.empty(samples),
        np.empty(samples),
        np.full(samples, speed_m_s),
        np.empty(samples),
        np.empty(samples, dtype=np.int64),
        np.full(samples, np.nan),
        np.full(ticks, np.nan),
        np.empty((ticks, 4)),
        np.empty(WAITING, dtype=np.int64),
        np.empty(WAITING),
    )


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
    known: Known | None


class Segment(NamedTuple):
    """Ticks that the controller spends in one mode, as ``range(first_tick, last_tick)``.

    ``is_recovery``  whether the law has just restarted while a command was being held
    """

    mode: int
    first_tick: int
    last_tick: int
    is_recovery: bool
