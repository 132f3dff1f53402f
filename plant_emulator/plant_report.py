"""The plant's part of a report, ready for JSON."""

from collections.abc import Mapping
from typing import Any

from ..runtime.statistics import durations_report
from .latency_line import LatencyLine
from .plant_samples import RunningFigures


def motion_report(figures: RunningFigures, motion_ns: int) -> Mapping[str, Any]:
    """Return the figures of the motion."""
    return {
        "motion_s": motion_ns * 1e-9,
        "samples": figures.samples,
        "lateral_error_rms_m": figures.lateral_error_rms_m,
        "lateral_error_peak_m": figures.lateral_error_peak_m,
        "lateral_error_final_m": figures.lateral_error_final_m,
        "wheel_angle_peak_rad": figures.wheel_angle_peak_rad,
    }


def line_report(line: LatencyLine[Any]) -> Mapping[str, Any]:
    """Return the network's figures of one direction.

    ``injected``  latency drawn for every frame that was not lost
    ``latency``   latency of the frames that have left: shorter where late frames are overtaken and
                  dropped
    """
    return {
        **line.counts._asdict(),
        "injected": durations_report(line.injected.summary()),
        "latency": durations_report(line.latency.summary()),
    }
