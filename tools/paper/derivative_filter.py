"""The derivative filter at 80 ms of delay: where each law is stable, and which errs less.

Every implementation filters the derivative, and the paper gives no filter. So Figure 21 is also
shown over N, the filter of C(s) = K_p + K_d s/(s/N + 1).
"""

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.pair_result import rms
from ...closed_loop.parameter_space.uncertainty import paper_box
from ...closed_loop.reports.plot_style import COLOURS
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.nominal_model import steer_to_lateral_error
from ...controller.laws.assembly import design_law
from ...controller.settings import controller_preset
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from .delay_runs import CDOB, PD, Law, delayed_plant, drive
from .result import Comparison, Picture, unpublished
from .simulation import PAPER_DELAY_S

_FILTERS_RAD_S = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0)
_WASHOUTS_RAD_S = (1.0, 3.0)
_SCAN_DURATION_S = 60.0


def filter_scan(name: str) -> Picture:
    """Draw the RMS error over the derivative filter, PD and PD+CDOB with either washout."""
    plant = delayed_plant(_SCAN_DURATION_S)
    columns: dict[str, FloatArray] = {"derivative_filter_rad_s": np.array(_FILTERS_RAD_S)}
    figure = Figure(figsize=(9.0, 4.6))
    axes = figure.subplots()
    for colour, law in zip(COLOURS, _scanned_laws(), strict=False):
        filtered = [
            law.changed(f"pd.derivative_filter_rad_s={filter_rad_s}")
            for filter_rad_s in _FILTERS_RAD_S
        ]
        rms_m = np.array([rms(drive([one], plant)[one.label].lateral_error_m) for one in filtered])
        last_rad_s = largest_filter_rad_s(law)
        columns[f"{law.label} rms_m"] = rms_m
        label = f"{law.label}: stable up to N = {last_rad_s:.1f} rad/s"
        axes.plot(_FILTERS_RAD_S, rms_m, "o-", color=colour, label=label)
        axes.axvline(last_rad_s, color=colour, lw=0.8, ls=":")
    axes.set(xlabel="derivative filter N [rad/s]", ylabel="RMS lateral error, 60 s [m]")
    axes.set(ylim=(0.0, None), title="80 ms of delay: where CDOB has the smaller error")
    axes.legend(loc="upper left")
    return Picture(name, figure, columns)


def filter_comparisons() -> tuple[Comparison, ...]:
    """Return up to which derivative filter each law is stable at the paper's delay."""
    return tuple(
        unpublished(
            f"stable at 80 ms, sampled loop with exact delay, {law.label}",
            f"up to N = {largest_filter_rad_s(law):.1f} rad/s",
        )
        for law in _scanned_laws()
    )


def _scanned_laws() -> list[Law]:
    return [PD] + [
        Law(f"PD+CDOB, washout {washout:g} rad/s", CDOB.preset).changed(
            f"cdob.washout_rad_s={washout}"
        )
        for washout in _WASHOUTS_RAD_S
    ]


def largest_filter_rad_s(law: Law) -> float:
    """Return the N at which the sampled loop loses its stability at the paper's delay [rad/s].

    By bisection between the ends of the scan, of which the lower is stable and the upper is not.
    """
    model = steer_to_lateral_error(paper_box().nominal)
    low_rad_s, high_rad_s = _FILTERS_RAD_S[0], _FILTERS_RAD_S[-1]
    while high_rad_s - low_rad_s > 0.05:
        middle_rad_s = 0.5 * (low_rad_s + high_rad_s)
        changed = law.changed(f"pd.derivative_filter_rad_s={middle_rad_s}")
        controller = controller_preset(changed.preset, changed.overrides)
        loop = SampledLoop(design_law(controller), model, controller.period_ns)
        if loop.is_stable(round(PAPER_DELAY_S * NS_PER_S)):
            low_rad_s = middle_rad_s
        else:
            high_rad_s = middle_rad_s
    return low_rad_s
