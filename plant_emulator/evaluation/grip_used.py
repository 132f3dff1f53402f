"""Whether a car had used up its grip before it left its lane: the one rule of every verdict.

The grip of an axle is used up at a sample where its tyres give USED_UP of μ F_z or more
(``vehicle.car.axle_use``). Samples count until a corner of the body is first beyond an edge of the
lane: what happens after that is not why the lane was left. Of a car that has left its path as well,
as by a spin, and had grip in its lane, the samples until then count.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

USED_UP = 0.99
"""A Fiala tyre that slides gives all, the Magic Formula 0.998 with its default shape."""


class GripUsed(NamedTuple):
    """Samples that count, those with an axle's grip used up, and when each first was; NaN: never.

    ``left_s``  when the lane, or the path, was left; NaN: it was not
    """

    samples: int = 0
    front: int = 0
    rear: int = 0
    front_s: float = math.nan
    rear_s: float = math.nan
    left_s: float = math.nan

    @property
    def first_s(self) -> float:
        """When the grip that a car lacked later was first used up; NaN: it had enough."""
        known_s = [time_s for time_s in (self.front_s, self.rear_s) if not math.isnan(time_s)]
        return min(known_s) if known_s and not math.isnan(self.left_s) else math.nan


class GripWatch(NamedTuple):
    """The grip used up to the end of the lane, and in the whole run."""

    in_lane: GripUsed = GripUsed()
    in_all: GripUsed = GripUsed()

    def of_run(self, left_path_s: float) -> GripUsed:
        """Return what the verdict names; ``left_path_s``  NaN for a car that has not left it."""
        if math.isnan(self.in_lane.first_s):
            return self.in_all._replace(left_s=left_path_s)
        return self.in_lane


def grip_step(
    x: GripWatch, time_s: float, front_use: float, rear_use: float, beyond_lane_m: float
) -> GripWatch:
    """Take a sample: its time, what both axles use of their friction, and where the body is."""
    in_lane, in_all = x
    samples, front, rear, front_s, rear_s, left_s = in_all
    if in_lane.left_s >= 0.0:
        pass
    elif beyond_lane_m > 0.0:
        in_lane = GripUsed(samples, front, rear, front_s, rear_s, time_s)
    if front_use >= USED_UP:
        front += 1
        front_s = time_s if front == 1 else front_s
    if rear_use >= USED_UP:
        rear += 1
        rear_s = time_s if rear == 1 else rear_s
    return GripWatch(in_lane, GripUsed(samples + 1, front, rear, front_s, rear_s, left_s))


def grip_report(watch: GripWatch, left_path_s: float) -> Mapping[str, Any] | None:
    """Return what the verdict names, ready for JSON; None where the car had grip."""
    used = watch.of_run(left_path_s)
    if math.isnan(used.first_s):
        return None
    axles = {"front": (used.front, used.front_s), "rear": (used.rear, used.rear_s)}
    return {
        "left": "lane" if used is watch.in_lane else "path",
        "left_s": used.left_s,
        "from_s": used.first_s,
        **{
            axle: {"share": count / used.samples, "from_s": from_s}
            for axle, (count, from_s) in axles.items()
            if count
        },
    }
