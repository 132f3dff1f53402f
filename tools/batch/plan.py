"""What the network does to a run, laid down before it: which frame arrives when.

It depends on the settings and the seed alone, not on where the vehicle is, because latencies and
losses are drawn from streams of their own. The latency lines are those of the plant emulator
themselves, pushed and emptied at the instants at which virtual time would; so is the check of the
counters. A line that only delays by a constant needs neither: what enters comes out later.

Left out is what no control depends on: the two status messages.
"""

from itertools import islice
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.modes import Supervisor
from controller.settings import ControllerSettings, supervision_of
from dbc.messages import CAN_IDS, LateralError, Mode, SteeringCommand, SteeringStatus, VehicleState
from dbc.protection import COUNTERS, SequenceCheck, SequenceResult
from plant_emulator.latency import Distribution
from plant_emulator.latency_line import LatencyLine
from plant_emulator.latency_settings import LatencySettings
from plant_emulator.node import VEHICLE_STATE_PERIOD_NS
from plant_emulator.settings import PlantSettings
from plant_emulator.streams import Channel, uniforms
from runtime.node import NEVER_NS, NS_PER_S
from tools.batch.loop import Segment

IntArray = NDArray[np.int64]

SAMPLES_WITHOUT_ARRIVAL_MAX = 100_000
"""Samples after which a network that lets none through is taken to be shut."""


class Plan(NamedTuple):
    """The instants of a run; ``loop.Schedule`` says what each array means.

    ``segments``         the controller's modes, in order; empty where nothing ever arrived
    ``motion_start_ns``  NEVER_NS where the vehicle never moves
    ``end_ns``           when the last sample is taken
    """

    tick_ns: IntArray
    tick_sample: IntArray
    command_due_ns: IntArray
    command_tick: IntArray
    command_latency_ns: IntArray
    sample_ns: IntArray
    noise_m: NDArray[np.float64]
    segments: tuple[Segment, ...]
    motion_start_ns: int
    end_ns: int


class NothingArrivesError(ValueError):
    """No measurement reaches the controller, so that it never steers and the run never ends."""


def plan_run(plant: PlantSettings, controller: ControllerSettings) -> Plan:
    """Lay down a run. Raises NothingArrivesError."""
    supervision = supervision_of(controller)
    is_simple = (
        _is_constant(plant.latency.downlink)
        and _is_constant(plant.latency.uplink)
        and plant.sensor_period_ns <= supervision.measurement_timeout_ns
    )
    if is_simple:
        return plan_constant_latency(plant, controller)
    return plan_any_latency(plant, controller)


def plan_constant_latency(plant: PlantSettings, controller: ControllerSettings) -> Plan:
    """Lay down a run in which every frame arrives after the same latency, always in time."""
    up_ns, down_ns = (
        round(line.mean_s * NS_PER_S) for line in (plant.latency.uplink, plant.latency.downlink)
    )
    period_ns, sensor_ns = controller.period_ns, plant.sensor_period_ns
    first_tick_ns = -(-up_ns // period_ns) * period_ns
    motion_start_ns = first_tick_ns if plant.start_on_first_command else 0
    samples = -(-(motion_start_ns + plant.duration_ns) // sensor_ns) + 1
    end_ns = (samples - 1) * sensor_ns
    tick_ns = np.arange(first_tick_ns, end_ns + 1, period_ns)
    due_ns = tick_ns + down_ns
    through = np.flatnonzero(due_ns <= end_ns)
    return Plan(
        tick_ns=tick_ns,
        tick_sample=(tick_ns - up_ns) // sensor_ns,
        command_due_ns=due_ns[through],
        command_tick=through,
        command_latency_ns=np.full(len(through), down_ns),
        sample_ns=np.arange(samples) * sensor_ns,
        noise_m=_noise(plant, samples),
        segments=(Segment(int(Mode.ACTIVE), 0, len(tick_ns), False),) if len(tick_ns) else (),
        motion_start_ns=motion_start_ns,
        end_ns=end_ns,
    )


def plan_any_latency(plant: PlantSettings, controller: ControllerSettings) -> Plan:
    """Lay down a run frame by frame, with the latency lines of the plant emulator."""
    return _Rehearsal(plant, controller).plan()


class _Rehearsal:
    """A run without vehicle and law: only frames move."""

    def __init__(self, plant: PlantSettings, controller: ControllerSettings) -> None:
        self._plant = plant
        self._period_ns = controller.period_ns
        seed, latency = plant.seed, plant.latency
        self._downlink: LatencyLine[int] = LatencyLine(
            latency.downlink,
            uniforms(seed, Channel.DOWNLINK),
            uniforms(seed, Channel.DOWNLINK_DUPLICATES),
        )
        self._uplink: LatencyLine[int] = LatencyLine(
            latency.uplink,
            uniforms(seed, Channel.UPLINK),
            uniforms(seed, Channel.UPLINK_DUPLICATES),
        )
        table = controller.supervision
        self._check = SequenceCheck(table.max_counter_jump, table.recovery_frames)
        self._supervisor = Supervisor(supervision_of(controller), 0)
        self._samples_per_state = max(1, VEHICLE_STATE_PERIOD_NS // plant.sensor_period_ns)
        self._motion_start_ns = NEVER_NS if plant.start_on_first_command else 0
        self._newest_sample = -1
        self._ticks: list[tuple[int, int]] = []
        self._modes: list[tuple[int, int]] = []  # mode, first tick
        self._commands: list[tuple[int, int, int]] = []

    def plan(self) -> Plan:
        """Run and collect."""
        sample, tick = 0, 0
        sensor_ns, period_ns = self._plant.sensor_period_ns, self._period_ns
        while True:
            sample_ns, tick_ns = sample * sensor_ns, tick * period_ns
            now_ns = min(sample_ns, tick_ns)
            is_last = False
            if sample_ns == now_ns:
                self._sense(sample, now_ns)
                is_last = now_ns - self._motion_start_ns >= self._plant.duration_ns
                sample += 1
            self._measure(now_ns)
            if tick_ns == now_ns:
                self._control(now_ns)
                tick += 1
            if is_last:
                return self._collected(sample, now_ns)
            if not self._ticks and sample > SAMPLES_WITHOUT_ARRIVAL_MAX:
                raise NothingArrivesError(
                    f"no measurement arrived in {sample} samples: the uplink loses them"
                )

    def _sense(self, sample: int, now_ns: int) -> None:
        motion_ns = max(now_ns - self._motion_start_ns, 0)
        self._uplink.push(CAN_IDS[LateralError], sample, now_ns, motion_ns)
        self._uplink.push(CAN_IDS[SteeringStatus], sample, now_ns, motion_ns)
        if sample % self._samples_per_state == 0:
            self._uplink.push(CAN_IDS[VehicleState], sample, now_ns, motion_ns)

    def _measure(self, now_ns: int) -> None:
        for passage in self._uplink.pop_due(now_ns):
            if passage.key != CAN_IDS[LateralError]:
                continue
            if self._check.check(passage.item % COUNTERS) is SequenceResult.ACCEPTED:
                self._newest_sample = passage.item
                self._supervisor.on_measurement(passage.due_ns)

    def _control(self, now_ns: int) -> None:
        entered = self._supervisor.move_on(now_ns)
        if entered is not None:
            self._modes.append((int(entered), len(self._ticks)))
        if self._supervisor.mode is Mode.WAITING:
            return
        self._motion_start_ns = min(self._motion_start_ns, now_ns)
        self._take_commands(now_ns)
        tick = len(self._ticks)
        motion_ns = max(now_ns - self._motion_start_ns, 0)
        self._downlink.push(CAN_IDS[SteeringCommand], tick, now_ns, motion_ns)
        self._ticks.append((now_ns, self._newest_sample))

    def _take_commands(self, now_ns: int) -> None:
        self._commands += [
            (passage.due_ns, passage.item, passage.latency_ns)
            for passage in self._downlink.pop_due(now_ns)
        ]

    def _collected(self, samples: int, end_ns: int) -> Plan:
        self._take_commands(end_ns)
        ticks = np.array(self._ticks, dtype=np.int64).reshape(-1, 2)
        commands = np.array(self._commands, dtype=np.int64).reshape(-1, 3)
        ends = [first for _, first in self._modes[1:]] + [len(ticks)]
        segments = tuple(
            Segment(mode, first, end, index > 0)
            for index, ((mode, first), end) in enumerate(zip(self._modes, ends, strict=True))
        )
        return Plan(
            tick_ns=ticks[:, 0].copy(),
            tick_sample=ticks[:, 1].copy(),
            command_due_ns=commands[:, 0].copy(),
            command_tick=commands[:, 1].copy(),
            command_latency_ns=commands[:, 2].copy(),
            sample_ns=np.arange(samples) * self._plant.sensor_period_ns,
            noise_m=_noise(self._plant, samples),
            segments=segments,
            motion_start_ns=self._motion_start_ns,
            end_ns=end_ns,
        )


def _is_constant(line: LatencySettings) -> bool:
    """Whether the line does nothing but delay every frame by its mean."""
    return (
        line.model is Distribution.CONSTANT
        and line.loss == 0.0
        and line.burst_frames is None
        and line.duplicates == 0.0
        and not line.schedule
        and line.trace_file is None
    )


def _noise(plant: PlantSettings, samples: int) -> NDArray[np.float64]:
    """Return what the sensor adds to each sample's lateral error, as ``with_noise`` does [m]."""
    deviation_m = plant.sensor_noise.lateral_error_m
    if deviation_m == 0.0:
        return np.zeros(samples)
    normal = NormalDist().inv_cdf
    first_of_three = islice(uniforms(plant.seed, Channel.SENSOR_NOISE), 0, 3 * samples, 3)
    return np.array([deviation_m * normal(u) for u in first_of_three])
