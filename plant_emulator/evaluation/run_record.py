"""Record of a run: one sample per sensor period, and figures that need no samples."""

import csv
import math
from collections import Counter, deque
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import NamedTuple

from ...dbc.messages import SteeringCommand
from ...runtime.fast_named_tuple import new_record
from ...runtime.output_file import open_text
from ..path.cg_deviation import cg_deviation_m
from ..path.corridor import BETWEEN, Corridor, Lane, Outside, beyond_lane_m, outside_at
from ..path.path import Path, pose
from ..vehicle.car.axle_use import AxleUse
from ..vehicle.exact_propagation import LinearState
from ..vehicle.moving_vehicle import Motion
from ..vehicle.settings import VehicleSettings
from .grip_used import GripUsed, grip_step
from .held_figures import NOTHING_HELD, HeldRules, held_step
from .run_verdict import Peaks, VerdictRules, samples_judged

SAMPLES_MAX = 1_000_000
"""Samples stored for a trace: nearly three hours at 100 Hz."""
_BLOCK = 16
"""Samples processed together, which saves 4 % of a tick; few enough that no tick takes long."""


class PlantSample(NamedTuple):
    """The true state of the plant at one sensor period; NaN if there is no value yet."""

    time_s: float  # since the start of motion
    arc_length_m: float
    lateral_error_m: float  # at the preview point, without noise
    heading_error_rad: float
    yaw_rate_rad_s: float
    command_rad: float  # in effect
    wheel_angle_rad: float
    downlink_latency_s: float  # of the command in effect
    uplink_latency_s: float  # of the measurement that left last
    curvature_1_m: float
    side_slip_rad: float
    cg_deviation_m: float  # of the centre of gravity from the path


class PlacedSample(NamedTuple):
    """Position of a sample: the preview point, and the point of the path at its distance."""

    x_m: float
    y_m: float
    path_x_m: float
    path_y_m: float


_Taken = tuple[
    int, LinearState, float, SteeringCommand | None, tuple[float, float], str, AxleUse | None
]
"""Time [ns], state and arc length [m] of motion, the command in effect, both latencies [s], the
limit, and the use of both axles.
"""


class RunningFigures:
    """Figures of a run, taken up sample by sample.

    ``newest``  how many of the newest errors and wheel angles are kept

    ``rules``    when the judged point has settled
    ``newest_m`` of the judged point's error
    ``outside``  where the body was farthest beyond an edge of its corridor; None without one
    ``beyond_lane_m``  how far a corner of the body was beyond an edge of its lane; NaN without one
    ``grip``     what it had used of its grip, and ``left_path_s``: when it left its path, or NaN
    ``limited``  samples at which a limit decided about the wheel, by its name
    ``stands``   whether the car stands still now
    """

    def __init__(self, rules: HeldRules, newest: int = 0) -> None:
        self.rules, self.held = rules, NOTHING_HELD
        self.outside: Outside | None = None
        self.beyond_lane_m = math.nan
        self.grip, self.left_path_s = GripUsed(), math.nan
        self.limited: Counter[str] = Counter()
        self.stands = False
        self.newest_m: deque[float] = deque(maxlen=newest)
        self.newest_wheel_rad: deque[float] = deque(maxlen=newest)

    def add(
        self, error_m: float, deviation_m: float, judged_m: float, wheel_rad: float, limit: str
    ) -> None:
        """Add a sample, as for ``held_step``; ``limit`` decides about the wheel, empty for none."""
        self.held = held_step(self.rules, self.held, error_m, deviation_m, judged_m, wheel_rad)
        self.newest_m.append(judged_m)
        self.newest_wheel_rad.append(wheel_rad)
        if limit:
            self.limited[limit] += 1

    @property
    def peaks_m(self) -> Peaks:
        """Largest errors of the judged point, and of the body."""
        return Peaks(
            self.held.judged_peak_m,
            self.held.settled_peak_m if self.held.settled else math.nan,
            math.nan if self.outside is None else self.outside.outside_m,
            self.beyond_lane_m,
        )


class RunRecord:
    """Figures of a run and, while there is room, its samples.

    ``corridor``, ``lane``  in which the body has to stay
    """

    def __init__(
        self,
        motion: Motion,
        vehicle: VehicleSettings,
        rules: VerdictRules,
        duration_s: float,
        period_s: float,
        samples_max: int,
        corridor: Corridor | None = None,
        lane: Lane | None = None,
    ) -> None:
        self._motion, self._corridor, self._lane = motion, corridor, lane
        self._behind_m = rules.behind_preview_m(vehicle)
        held_rules = HeldRules(rules.settling_band_m, math.ceil(rules.settled_s / period_s))
        newest = samples_judged(rules, duration_s, period_s)
        self._figures = RunningFigures(held_rules, newest)
        self._figures.outside = None if corridor is None else BETWEEN
        self._samples: list[PlantSample] = []
        self._samples_max = samples_max
        self._waiting: list[_Taken] = []
        """Samples that are neither in the figures nor in ``samples`` yet."""

    @property
    def figures(self) -> RunningFigures:
        """Figures of all samples so far."""
        self._process_waiting()
        self._figures.stands = self._motion.speed_m_s == 0.0
        return self._figures

    @property
    def samples(self) -> Sequence[PlantSample]:
        """The samples that are kept, oldest first."""
        self._process_waiting()
        return self._samples

    def on_sample(
        self, command: SteeringCommand | None, latencies_s: tuple[float, float], limit: str
    ) -> None:
        """Record a sample of the motion, of the command in effect, and of what limits the wheel.

        ``latencies_s``  of that command, and of the measurement that left last
        """
        motion, waiting = self._motion, self._waiting
        at_m, _ = motion.place
        use = None if self._lane is None else motion.axle_use
        waiting.append((motion.time_ns, motion.linear, at_m, command, latencies_s, limit, use))
        if len(waiting) >= _BLOCK:
            self._process_waiting()

    def _process_waiting(self) -> None:
        """Add the waiting samples to the figures, and keep those for which there is room."""
        path = self._motion.path
        preview_m, behind_m = self._motion.preview_distance_m, self._behind_m
        figures = self._figures
        for time_ns, linear, at_m, command, (downlink_s, uplink_s), limit, use in self._waiting:
            side_slip_rad, yaw_rate_rad_s, heading_rad, error_m, wheel_rad, _, rho, _, _, _ = linear
            cg_m = cg_deviation_m(path, at_m, heading_rad, error_m, preview_m)
            if behind_m == preview_m:
                judged_m = cg_m
            elif behind_m == 0.0:
                judged_m = error_m
            else:
                judged_m = cg_deviation_m(path, at_m, heading_rad, error_m, behind_m)
            if self._corridor is not None:
                where = at_m, heading_rad, error_m, preview_m
                outside = outside_at(self._corridor, path, *where)
                figures.outside = max(figures.outside or BETWEEN, outside)
            if self._lane is not None:
                rear_m = cg_deviation_m(
                    path, at_m, heading_rad, error_m, preview_m + self._lane.rear_m
                )
                at = preview_m, heading_rad, error_m, rho
                beyond_m = float(beyond_lane_m(self._lane, *at, rear_m))
                # The first one takes the place of a NaN.
                figures.beyond_lane_m = max(beyond_m, figures.beyond_lane_m)
                if use is not None:
                    used = use.front_grip_used, use.rear_grip_used
                    figures.grip = grip_step(figures.grip, time_ns * 1e-9, *used, beyond_m)
            figures.add(error_m, cg_m, judged_m, wheel_rad, limit)
            if len(self._samples) >= self._samples_max:
                continue
            steer_rad = math.nan if command is None else command.steer_rad
            turns = heading_rad, yaw_rate_rad_s, steer_rad, wheel_rad
            others = downlink_s, uplink_s, rho, side_slip_rad, cg_m
            sample = (time_ns * 1e-9, at_m, error_m, *turns, *others)
            self._samples.append(new_record(PlantSample, sample))
        self._waiting.clear()


def motion_cg_m(motion: Motion) -> float:
    """Return the deviation of the centre of gravity now [m]."""
    _, _, heading_rad, error_m, _, _, _, _, _, _ = motion.linear
    at_m, preview_m = motion.arc_length_m, motion.preview_distance_m
    return cg_deviation_m(motion.path, at_m, heading_rad, error_m, preview_m)


def place(path: Path, sample: PlantSample) -> PlacedSample:
    """Return the position of a sample."""
    beside = pose(path, sample.arc_length_m)
    return PlacedSample(
        beside.x_m - sample.lateral_error_m * math.sin(beside.heading_rad),
        beside.y_m + sample.lateral_error_m * math.cos(beside.heading_rad),
        beside.x_m,
        beside.y_m,
    )


def write_trace(file: FilePath, path: Path, samples: Sequence[PlantSample]) -> None:
    """Write samples and their places as CSV, one row a sample; missing values are empty."""
    with open_text(file) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow((*PlantSample._fields, *PlacedSample._fields))
        for sample in samples:
            values = (*sample, *place(path, sample))
            writer.writerow(["" if math.isnan(value) else repr(value) for value in values])
