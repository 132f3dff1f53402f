"""Warnings about settings that contradict what is measured, or will be."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...runtime.node import NS_PER_S
from ..settings import ControllerSettings


def contradictions(settings: ControllerSettings, node: Mapping[str, Any]) -> Iterator[str]:
    """Return warnings about settings that contradict what the run has measured."""
    age_s = node["sample_age"]["mean_s"]
    # With a measurement at every tick the newest is never older than a period; with fewer it is
    # half a sensor period old on average.
    is_rare = age_s * settings.rate_hz > 1.5
    if is_rare and (warning := sparse_measurements(settings, 2.0 * age_s)):
        yield warning
    period = node["sensor_period"]
    if period is not None and period["times_wrong"]:
        yield (
            f"the plant's sensor period was about {1e3 * period['measured_s']:.3g} ms, but "
            f"link.sensor_period_ms = {1e3 * period['setting_s']:g}: the law did without the delay"
        )


def sparse_measurements(settings: ControllerSettings, sensor_period_s: float) -> str:
    """Return a warning where the law differentiates measurements rarer than its ticks, else "".

    An unfiltered derivative then acts in the first tick after each measurement only. The paper's
    presets are such laws at 1 kHz.
    """
    period_s, pd = settings.period_ns / NS_PER_S, settings.pd
    is_ideal = pd is not None and pd.derivative_filter_rad_s is None
    if not is_ideal or sensor_period_s < 1.5 * period_s:
        return ""
    return (
        f"warning: measurements about every {1e3 * sensor_period_s:.3g} ms for a control period of"
        f" {1e3 * period_s:.3g} ms make this another law, as its derivative has no filter; set the"
        f" plant's sensor_period_ms = {1e3 * period_s:.3g}"
    )
