"""The plant's part of a report, ready for JSON."""

import math
from collections.abc import Mapping
from typing import Any

from ..network.latency_line import LatencyLine
from .run_record import RunningFigures
from .run_verdict import RANGE_M, RunEnd, VerdictRules, judge


def motion_report(
    figures: RunningFigures,
    motion_ns: int,
    rules: VerdictRules,
    noise_m: float,
    period_s: float,
    is_driven: bool,
) -> Mapping[str, Any]:
    """Return how well the path was held.

    ``is_driven``         whether measurements and commands ever arrived, or no command was sent

    ``*rms_m``, ``peak_m``, ``final_m``  of the car's deviation; None if a log has none
    ``lateral_error_final_m``  of the judged point: what the verdict takes for the lateral error
    ``settling_s``        from when on the judged point stays in its band; None if it ends outside
    ``verdict``           on the run so far, of its ``judged_point``, by ``judged_peak_m``,
                          ``settled_peak_m`` (from ``settled_s`` on) and ``windows``
    ``beyond_lane_m``     how far a corner of a car was beyond an edge of its lane; None without one
    ``grip_used``         how much of the time, and from when on, each axle had used up its grip
                          before the lane was left; None where neither had, or it was not left
    ``corridor``          where the body was farthest beyond an edge (``path.corridor.Outside``);
                          None without a corridor, and before it
    ``limited_share``     share of the time in which a limit, and not the command, decided about the
                          wheel, and ``limited_share_by`` limit
    ``stands``            whether the car stood still at the end; of a log: or went backward
    """
    held, peaks_m = figures.held, figures.peaks_m
    samples, outside = held.samples, figures.outside
    newest = list(figures.newest_m), list(figures.newest_wheel_rad)
    end = RunEnd.LEFT_RANGE if held.preview_peak_m > RANGE_M else RunEnd.COMPLETE
    end = end if samples and is_driven else RunEnd.NO_START
    judged = judge(rules, *newest, end, noise_m, peaks_m, period_s, samples)
    is_cg_known = not math.isnan(held.rms_m)
    return {
        "motion_s": motion_ns * 1e-9,
        "samples": samples,
        "rms_m": held.rms_m if is_cg_known else None,
        "settled_rms_m": _known(held.settled_rms_m),
        "peak_m": held.peak_m if is_cg_known else None,
        "final_m": held.final_m if is_cg_known else None,
        "preview_rms_m": held.preview_rms_m,
        "preview_peak_m": held.preview_peak_m,
        "lateral_error_final_m": held.judged_final_m,
        "wheel_angle_peak_rad": held.wheel_angle_peak_rad,
        "settling_s": held.settled_at * period_s if held.settled_at < samples else None,
        **judged.report(),
        "judged_point": rules.judged_point,
        "judged_peak_m": peaks_m.whole_m,
        "settled_s": rules.settled_s,
        "settled_peak_m": _known(peaks_m.settled_m),
        "beyond_lane_m": _known(peaks_m.beyond_lane_m),
        "grip_used": figures.grip.report(figures.left_path_s),
        "corridor": outside._asdict() if outside and outside.section else None,
        "limited_share": sum(figures.limited.values()) / max(samples, 1),
        "limited_share_by": {
            limit: count / samples for limit, count in figures.limited.most_common()
        },
        "stands": figures.stands,
    }


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def line_report(line: LatencyLine[Any]) -> Mapping[str, Any]:
    """Return the network's figures of one direction.

    ``injected``  latency drawn for every frame that was not lost
    ``latency``   latency of the frames that have left: shorter where late frames are overtaken and
                  dropped
    """
    return {
        **line.counts._asdict(),
        "injected": line.injected.report(),
        "latency": line.latency.report(),
    }
