"""Use of the grip before a car leaves its lane: one rule for every verdict.

The grip of an axle is used up at a sample where its tyres give USED_UP of μ F_z or more
(``vehicle.car.axle_use``). Samples count until a corner of the body is first beyond an edge of the
lane: what happens after that is not why the lane was left. Of a car that still had grip then, and
leaves its path as well, as by a spin, the samples until it does count.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

USED_UP = 0.99
"""A Fiala tyre that slides gives all, the Magic Formula 0.998 with its default shape."""


class GripUsed(NamedTuple):
    """Samples that count, those with an axle's grip used up, and when each first was; NaN: never.

    ``left_s``  when the lane was left without grip; NaN: it was not
    """

    samples: int = 0
    front: int = 0
    rear: int = 0
    front_s: float = math.nan
    rear_s: float = math.nan
    has_left_lane: bool = False
    left_s: float = math.nan

    def report(self, left_path_s: float) -> Mapping[str, Any] | None:
        """Return what the verdict names, ready for JSON; None where there was grip.

        ``left_path_s``  NaN for a car that has not left its path
        """
        left, left_s = "lane", self.left_s
        if math.isnan(left_s):
            left, left_s = "path", left_path_s
        axles = {"front": (self.front, self.front_s), "rear": (self.rear, self.rear_s)}
        used = {
            axle: {"share": count / self.samples, "from_s": from_s}
            for axle, (count, from_s) in axles.items()
            if count
        }
        if not used or math.isnan(left_s):
            return None
        from_s = min(one["from_s"] for one in used.values())
        return {"left": left, "left_s": left_s, "from_s": from_s, **used}


def grip_step(
    x: GripUsed, time_s: float, front_use: float, rear_use: float, beyond_lane_m: float
) -> GripUsed:
    """Take a sample: its time, what both axles use of their friction, and where the body is."""
    samples, front, rear, front_s, rear_s, has_left_lane, left_s = x
    if not math.isnan(left_s):
        return x
    if beyond_lane_m > 0.0 and not has_left_lane:
        if front or rear:
            return x._replace(has_left_lane=True, left_s=time_s)
        has_left_lane = True
    if front_use >= USED_UP:
        front, front_s = front + 1, front_s if front else time_s
    if rear_use >= USED_UP:
        rear, rear_s = rear + 1, rear_s if rear else time_s
    return GripUsed(samples + 1, front, rear, front_s, rear_s, has_left_lane, left_s)
