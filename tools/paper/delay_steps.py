"""Additions to Figure 21: the effect of the derivative filter, and a step of the reference.

The step, on a straight road, is what (18), y/r, describes. The nodes have no reference: their path
is the reference. So law and vehicle run here without nodes and frames, in the order of one control
period: measure, decide, limit, hold. The reference enters the PD alone, as in Figure 6. The law is
started at rest at the error -r; the observers' filters, with the double zero of Q/G_n at s = 0, do
not respond to it.
"""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.pair_result import rms
from ...closed_loop.parameter_space.uncertainty import paper_box
from ...closed_loop.reports.plot_style import COLOURS
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.nominal_model import steer_to_lateral_error
from ...controller.filters.settings import VehicleModelSettings
from ...controller.interface.law import LawInput
from ...controller.interface.steer_limits import limit_step
from ...controller.laws.assembly import design_law
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.path.settings import StraightSettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.motion_parameters import motion_params
from ...plant_emulator.vehicle.moving_vehicle import Motion
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from .delay_runs import CDOB, FILTER, PD, Law, delayed_plant, drive
from .result import Comparison, Picture, unpublished
from .simulation import PAPER_DELAY_S


class Step(NamedTuple):
    """Time histories of a step, one row a control period; y - r is the error."""

    time_s: FloatArray
    error_m: FloatArray
    steer_rad: FloatArray


def reference_step(
    plant: PlantSettings,
    controller: ControllerSettings,
    reference_m: float,
    delay_s: float,
    duration_s: float,
) -> Step:
    """Return the response to a reference of ``reference_m`` from time 0 on, on a straight road.

    ``delay_s``  of the command, rounded to whole control periods
    """
    design, limits = design_law(controller), controller.steer_limits
    motion = Motion(
        motion_params(plant.vehicle, plant.actuator, StraightSettings(), plant.disturbance)
    )
    period_ns = controller.period_ns
    on_their_way = deque([0.0] * round(delay_s * NS_PER_S / period_ns))
    state, steer_rad = design.initial_state(-reference_m), 0.0
    rows = []
    for index in range(round(duration_s * NS_PER_S / period_ns)):
        motion.advance(index * period_ns)
        error_m = motion.lateral_error_m - reference_m
        state, output = design.step(design.params, state, LawInput(error_m, steer_rad))
        steer_rad = limit_step(limits, steer_rad, output.steer_rad)
        on_their_way.append(steer_rad)
        motion.command(on_their_way.popleft())
        rows.append((index * period_ns / NS_PER_S, error_m, steer_rad))
    return Step(*np.array(rows, dtype=np.float64).T)


_FILTERS_RAD_S = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0)
_WASHOUTS_RAD_S = (1.0, 3.0)
_SCAN_DURATION_S = 60.0

_REFERENCE_M = 0.1
_STEP_DURATION_S = 20.0
_TAIL_S = 5.0


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


def step_picture(name: str, steps: Mapping[str, Step]) -> Picture:
    """Draw the responses to a step of the reference on a straight road."""
    figure = Figure(figsize=(10.5, 4.4))
    left, right = figure.subplots(1, 2)
    columns: dict[str, FloatArray] = {}
    for colour, (label, step) in zip(COLOURS, steps.items(), strict=False):
        time_s, error_m, steer_rad = (column[::20] for column in step)
        columns["time_s"] = time_s
        columns[f"{label} error_m"] = error_m
        columns[f"{label} steer_rad"] = steer_rad
        left.plot(time_s, error_m, color=colour, lw=1.0)
        right.plot(time_s, steer_rad, color=colour, lw=0.8, label=label)
    left.axhline(0.0, color="black", lw=0.6)
    left.set(xlabel="time [s]", ylabel="y - r [m]", title="Reference step of 0.1 m, straight road")
    right.set(xlabel="time [s]", ylabel="steering angle [rad]")
    figure.legend(loc="outside lower center", ncols=3)
    return Picture(name, figure, columns)


def step_comparisons(steps: Mapping[str, Step]) -> tuple[Comparison, ...]:
    """Return the RMS error in the last seconds of a reference step, and the RMS steer."""
    begin_s = _STEP_DURATION_S - _TAIL_S
    return tuple(
        unpublished(
            f"reference step of {_REFERENCE_M:g} m, straight road, 80 ms, N = 30 rad/s, {label}",
            f"RMS error of the last {_TAIL_S:g} of {_STEP_DURATION_S:g} s: "
            f"{rms(step.error_m[step.time_s >= begin_s]):.4f} m; "
            f"RMS steer {rms(step.steer_rad):.4f} rad",
        )
        for label, step in steps.items()
    )


def reference_steps(plant: PlantSettings) -> dict[str, Step]:
    """Return the responses to a step of the reference, by the name of the law."""
    pd = controller_preset(PD.preset, FILTER)
    cdob = controller_preset(CDOB.preset, FILTER)
    nominal = paper_box().nominal._asdict() | {"speed_m_s": plant.vehicle.speed_m_s}
    model = VehicleModelSettings(kind="vehicle", **nominal)
    own = cdob.model_copy(update={"nominal_model": model})
    laws = {"PD": pd, "PD+CDOB, G_n of (19)": cdob, "PD+CDOB, G_n of the vehicle": own}
    return {
        label: reference_step(plant, law, _REFERENCE_M, PAPER_DELAY_S, _STEP_DURATION_S)
        for label, law in laws.items()
    }
