"""The effect of the network on a run, computed beforehand: which frame arrives when.

It depends on the settings and the seed alone, not on where the vehicle is, because latencies and
losses are drawn from streams of their own. Whether the controller accepts a measurement, and which
mode it is in, also follow from the arrivals alone; the controller's own classes decide both.

The controller's status messages are left out, because control does not depend on them.
"""

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...controller.history.history import HistoryParams, empty_history
from ...controller.history.plan import ROW_LENGTH
from ...controller.law_interface import History
from ...controller.node.modes import Supervisor, supervision_of
from ...controller.settings import ControllerSettings
from ...dbc.messages import Mode, PathAhead, VehicleState, limits, resolutions
from ...plant_emulator.sensors.path_ahead import VALUES, spacing_m
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NEVER_NS, NS_PER_S
from .hand_wheel_events import WheelEvents, wheel_events
from .law_input import Uplink, quantised
from .loop_records import Inbox, Instants, Segment
from .network import Arrivals, arrivals_of, in_use_at, sensor_noise, to_plant_of
from .step_functions import register_steps

if TYPE_CHECKING:
    from ...hand_wheel.settings import HandWheelSettings

_OF_SAMPLES = [each for each in Uplink if each is not Uplink.STEERING_FORCE]
SAMPLES_WITHOUT_ARRIVAL_MAX = 100_000
"""A network that delivers none of this many samples counts as one that loses every frame."""


class RunSchedule(NamedTuple):
    """The instants of a run.

    ``instants``   as the loop reads them, without what only some runs need
    ``time_s``     of each sample since the motion's start, shape (samples since then,)
    ``tick_s``     of each tick, from the start of the run
    ``segments``   the controller's modes, in order
    ``end_ns``     when the last sample is taken
    ``commands_lost``      by the network, of the first ticks, shape (ticks + 1,); with a hand wheel
                           of all frames to the plant
    ``measurements_lost``  of the first samples, shape (samples + 1,): of all messages
    ``measurements``       that the controller accepts, and when
    ``first_tick``         the first tick with a command
    ``wheel``              events of a hand wheel
    """

    instants: Instants
    command_latency_ns: IntArray
    time_s: FloatArray
    tick_s: FloatArray
    segments: tuple[Segment, ...]
    motion_start_ns: int
    end_ns: int
    commands_lost: IntArray
    measurements_lost: IntArray
    measurements: "Measurements"
    first_tick: int
    wheel: WheelEvents | None


class Measurements:
    """The plant's messages as the controller accepts them; each is computed once for all runs."""

    def __init__(
        self,
        plant: PlantSettings,
        controller: ControllerSettings,
        samples: int,
        motion_start_ns: int,
        tick_ns: IntArray,
    ) -> None:
        self._plant, self._rule, self._limits = plant, controller.counters, controller.age_limits
        self._samples, self._motion_start_ns = samples, motion_start_ns
        self._tick_ns = tick_ns

    def arrivals(self, message: Uplink) -> Arrivals:
        """Return the arrivals of one message."""
        return arrivals_of(message, self._plant, self._rule, self._samples, self._motion_start_ns)

    def _in_use(self, message: Uplink) -> tuple[IntArray, IntArray]:
        """Return the sample of the newest message at each tick, -1 for none, and its age [ns]."""
        return in_use_at(self.arrivals(message), self._tick_ns)

    @cached_property
    def vehicle_in_use(self) -> IntArray:
        """``Instants.in_use`` without the last row."""
        sample, age_ns = self._in_use(Uplink.VEHICLE_STATE)
        return np.array([sample, age_ns > self._limits.vehicle_state_ns])

    @cached_property
    def status_in_use(self) -> IntArray:
        """``Instants.in_use`` with its last row: -1 for no status that is fresh."""
        sample, age_ns = self._in_use(Uplink.STEERING_STATUS)
        status = np.where(age_ns <= self._limits.steering_status_ns, sample, -1)
        return np.array([*self.vehicle_in_use, status])

    @cached_property
    def speed_known_ns(self) -> int:
        """When the first VEHICLE_STATE arrives."""
        return int(self.arrivals(Uplink.VEHICLE_STATE).arrival_ns.min(initial=NEVER_NS))

    @cached_property
    def received(self) -> tuple[IntArray, FloatArray]:
        """``Inbox.arrivals`` and ``Inbox.noise``."""
        each = [self.arrivals(message) for message in _OF_SAMPLES]
        message = np.repeat(_OF_SAMPLES, [len(arrivals.sample) for arrivals in each])
        sample = np.concatenate([arrivals.sample for arrivals in each])
        arrival_ns = np.concatenate([arrivals.arrival_ns for arrivals in each])
        order = np.lexsort((message, sample, arrival_ns))
        noise = np.array(sensor_noise(self._plant, self._samples, slice(1, 3)))
        return np.array([arrival_ns[order], message[order], sample[order]]), noise


class NothingArrivesError(ValueError):
    """No measurement reaches the controller, so that it never steers and the run never ends."""


def schedule_run(
    plant: PlantSettings, controller: ControllerSettings, wheel: "HandWheelSettings | None" = None
) -> RunSchedule:
    """Schedule a run; ``wheel``: of ``with_hand_wheel``. Raises NothingArrivesError.

    With a hand wheel, the first tick is that at 0: the controller says at once who steers.
    """
    register_steps()
    starts_late = plant.start_on_first_command and wheel is None
    first_command_ns = _first_tick_ns(plant, controller, starts_late)
    motion_start_ns = first_command_ns if starts_late else 0
    sensor_ns, period_ns = plant.sensor_period_ns, controller.period_ns
    samples = -(-(motion_start_ns + plant.duration_ns) // sensor_ns) + 1
    end_ns = (samples - 1) * sensor_ns
    rule = controller.counters
    arrivals = arrivals_of(Uplink.LATERAL_ERROR, plant, rule, samples, motion_start_ns)
    tick_ns = np.arange(first_command_ns if wheel is None else 0, end_ns + 1, period_ns)
    first = int(np.searchsorted(tick_ns, first_command_ns))
    in_use = np.searchsorted(arrivals.arrival_ns, tick_ns, side="right") - 1
    sent = [(first, tick_ns[first:])]
    if wheel is not None:
        sent += [(0, tick_ns), (0, np.arange(0, end_ns + 1, wheel.cycle_ns))]
    to_plant, commands_lost = to_plant_of(plant, sent, motion_start_ns, end_ns)
    is_command = to_plant.kind == 0
    segments = _segments(controller, arrivals, in_use[first:], tick_ns[first:])
    if wheel is not None:
        segments = (
            Segment(int(Mode.WAITING), 0, first, False),
            *(each._replace(first_tick=each.first_tick + first, last_tick=each.last_tick + first)
              for each in segments),
        )  # fmt: skip
    sample_ns = np.arange(samples) * sensor_ns
    # The sample at the instant of the first command is taken before that command.
    is_moving = sample_ns >= motion_start_ns + int(plant.start_on_first_command)
    motion_ns = np.maximum(sample_ns - motion_start_ns, 0)
    measurements = Measurements(plant, controller, samples, motion_start_ns, tick_ns)
    events = None
    if wheel is not None:
        statuses = measurements.arrivals(Uplink.STEERING_STATUS)
        events = wheel_events(plant, wheel, sample_ns, tick_ns, to_plant, statuses)
    instants = Instants(
        ticks=np.array([tick_ns, arrivals.sample[in_use]]),
        commands=np.array([to_plant.due_ns[is_command], to_plant.number[is_command]]),
        sample_ns=sample_ns,
        noise_m=sensor_noise(plant, samples, slice(1))[0],
        in_use=np.empty((0, 0), np.int64),
    )
    return RunSchedule(
        instants=instants,
        command_latency_ns=to_plant.latency_ns[is_command],
        time_s=np.multiply(motion_ns[is_moving], 1e-9),
        tick_s=np.multiply(tick_ns, 1e-9),
        segments=segments,
        motion_start_ns=motion_start_ns,
        end_ns=end_ns,
        commands_lost=commands_lost,
        measurements_lost=arrivals.lost,
        measurements=measurements,
        first_tick=first,
        wheel=events,
    )


def _first_tick_ns(plant: PlantSettings, controller: ControllerSettings, starts_late: bool) -> int:
    """Return the tick at which the controller stops waiting, and the motion if ``starts_late``."""
    timeout_ns = supervision_of(controller).measurement_timeout_ns
    period_ns, samples = controller.period_ns, 1
    rule = controller.counters
    while samples <= SAMPLES_WITHOUT_ARRIVAL_MAX:
        # Frames after the start have another time of motion, but none of them is the first.
        start_ns = NEVER_NS if starts_late else 0
        arrival_ns = arrivals_of(Uplink.LATERAL_ERROR, plant, rule, samples, start_ns).arrival_ns
        tick_ns = -(-arrival_ns // period_ns) * period_ns
        known_ns = (samples - 1) * plant.sensor_period_ns  # later ones may overtake beyond that
        fresh = (tick_ns - arrival_ns <= timeout_ns) & (tick_ns <= known_ns)
        if fresh.any():
            return int(tick_ns[np.argmax(fresh)])
        samples *= 4
    raise NothingArrivesError(
        f"no measurement came into use in {SAMPLES_WITHOUT_ARRIVAL_MAX} samples: the uplink loses "
        "them, or they overtake each other by more than controller.supervision.counter_lead_ms"
    )


def _segments(
    controller: ControllerSettings, arrivals: Arrivals, in_use: IntArray, tick_ns: IntArray
) -> tuple[Segment, ...]:
    """Return the modes of the ticks; the first tick ends the wait."""
    supervision = supervision_of(controller)
    arrival_ns = arrivals.arrival_ns
    is_fresh = tick_ns - arrival_ns[in_use] <= supervision.measurement_timeout_ns
    if is_fresh.all():
        return (Segment(int(Mode.ACTIVE), 0, len(tick_ns), False),)
    supervisor, arrived = Supervisor(supervision, 0), 0
    before_ns: int | None = None
    entered: list[tuple[Mode, int]] = []
    for tick, (now_ns, newest) in enumerate(zip(tick_ns.tolist(), in_use.tolist(), strict=True)):
        while arrived <= newest:
            arrived_ns = int(arrival_ns[arrived])
            supervisor.on_measurement(before_ns, arrived_ns)
            before_ns = arrived_ns
            arrived += 1
        mode = supervisor.move_on(before_ns, now_ns)
        if mode is not None:
            entered.append((mode, tick))
    ends = [first for _, first in entered[1:]] + [len(tick_ns)]
    return tuple(
        Segment(int(mode), first, end, index > 0 and entered[index - 1][0] is not Mode.ACTIVE)
        for index, ((mode, first), end) in enumerate(zip(entered, ends, strict=True))
    )


def inbox_of(plant: PlantSettings, controller: ControllerSettings, schedule: RunSchedule) -> Inbox:
    """Return the inbox of one run's law, with all that does not depend on how the vehicle moves."""
    samples = len(schedule.instants.sample_ns)
    every = samples_per_vehicle_state(plant.sensor_period_ns)
    messages = 0 if plant.path_ahead is None else -(-samples // every)
    return Inbox(
        HistoryParams(controller.loop_delay, controller.age_limits),
        empty_rings(keeps_plans=controller.law_record.plan is not None),
        *schedule.measurements.received,
        signals=np.empty((5, samples)),
        status=np.empty(samples, dtype=np.int64),
        periods_per_sample=controller.link.sensor_period_s / (controller.period_ns / NS_PER_S),
        buffer=np.zeros(ROW_LENGTH),
        samples_per_path=every,
        path_spacing_m=_path_spacing_m(plant),
        path_ahead_1_m=np.empty((messages, VALUES)),
        first_tick=schedule.first_tick,
        played_rad=np.full(samples if controller.law_record.plan is not None else 0, np.nan),
    )


def _path_spacing_m(plant: PlantSettings) -> float:
    """Return the spacing of PATH_AHEAD as the wire carries it, 0 where it is not sent [m]."""
    if plant.path_ahead is None:
        return 0.0
    wanted_m = spacing_m(plant.vehicle.speed_m_s, plant.path_ahead.reach_s)
    return float(quantised(wanted_m, resolutions(PathAhead)["path_spacing_m"]))


@lru_cache(maxsize=256)
def quantised_speed_m_s(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it [m/s]."""
    highest_m_s = limits(VehicleState)["speed_m_s"].maximum
    return float(quantised(min(speed_m_s, highest_m_s), resolutions(VehicleState)["speed_m_s"]))


def empty_rings(*, keeps_plans: bool) -> History:
    """Return the initial history of ``BusHistory``, as arrays."""
    rings, arrays = _empty_rings(keeps_plans)
    return rings._replace(**{name: array.copy() for name, array in arrays.items()})


@lru_cache
def _empty_rings(keeps_plans: bool) -> tuple[History, dict[str, Any]]:
    rings = empty_history(keeps_plans=keeps_plans)
    lists = {name: ring for name, ring in rings._asdict().items() if isinstance(ring, list)}
    return rings, {name: np.array(ring) for name, ring in lists.items()}
