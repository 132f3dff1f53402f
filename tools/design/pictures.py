"""One picture of a design: region of the gains, RMS over delay, sensitivity, stable delays."""
# ruff: noqa: RUF001  # σ is the paper's symbol

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.parameter_space.drawing import GAIN_LABELS, draw_curves, fill_region
from ...closed_loop.parameter_space.gain_boundaries import Window
from ...closed_loop.reports.plot_style import COLOURS
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.laws.assembly import design_law, required
from ...runtime.node import NS_PER_MS, NS_PER_S
from .candidate import pd_region, settled_region
from .design import Design
from .loop_figures import behind_lag, frequency_grid, law_response, sensitivity_size
from .specification import Specification
from .vehicle_file import VehicleFile

_POINTS = 800
_OMEGA_RAD_S_MIN = 0.05
_DELAYS_DRAWN = 60
_CORNERS_NAMED_MAX = 4


def draw_design(spec: Specification, vehicle: VehicleFile, design: Design) -> Figure:
    """Draw the four panels."""
    figure = Figure(figsize=(12.0, 9.0))
    (region, rms), (sensitivity, stable) = figure.subplots(2, 2)
    _draw_region(region, spec, vehicle, design)
    _draw_rms(rms, spec, vehicle, design)
    _draw_sensitivity(sensitivity, spec, vehicle, design)
    _draw_decay(stable, spec, vehicle, design)
    values = ", ".join(f"{reason.key} {reason.value:g}" for reason in design.reasons)
    figure.suptitle(f"{spec.name}_{design.law}: {values}", fontsize=10.0, color="0.35")
    return figure


def _draw_region(axes: Axes, spec: Specification, vehicle: VehicleFile, design: Design) -> None:
    pd = required(design.settings.pd)
    k_p, k_d = pd.proportional_gain_rad_m, pd.derivative_gain_rad_s_m
    window = Window(1e-3 * k_p, 3.0 * k_p, 1e-3 * k_d, 4.0 * k_d)
    filter_rad_s = pd.derivative_filter_rad_s or math.inf
    alone = pd_region(spec, vehicle, filter_rad_s, window)
    whole = settled_region(spec, vehicle, design.settings, window)
    table = spec.d_stability
    fill_region(axes, alone, "PD alone: σ, θ and R", alpha=0.15)
    fill_region(axes, whole, f"law: σ at 0 to {spec.delay.ms_max:g} ms", alpha=0.35)
    draw_curves(axes, alone.curves)
    axes.plot(k_p, k_d, "*", ms=14, color="black", label=f"chosen: {k_p:g}, {k_d:g}")
    axes.set(**GAIN_LABELS, xlim=(0.0, window.k_p_max), ylim=(0.0, window.k_d_max))
    axes.set_title(
        f"Gains: σ = {table.settling_1_s:g} 1/s, θ = {table.cone_angle_deg:g}°,"
        f" R = {table.bandwidth_rad_s:g} rad/s",
        fontsize=10,
    )
    axes.legend(fontsize=8)


def _draw_rms(axes: Axes, spec: Specification, vehicle: VehicleFile, design: Design) -> None:
    delay_ms = np.array(design.rms.delays_ns) / NS_PER_MS
    for colour, label, rms_m in zip(
        _colours(vehicle), _labels(vehicle), design.rms.rms_m, strict=True
    ):
        axes.plot(delay_ms, 1e3 * rms_m, color=colour, label=label)
    largest_m = spec.rms_m_max_of(design.law)
    inside = delay_ms <= spec.delay.ms_max
    highest_mm = 1e3 * max(float(design.rms.rms_m[:, inside].max()), largest_m or 0.0)
    if largest_m is not None:
        axes.axhline(1e3 * largest_m, color="black", lw=0.9, ls="--", label="limit")
    _shade_range(axes, spec)
    axes.set(xlabel="constant delay [ms]", ylabel="RMS of the lateral error [mm]")
    axes.set(ylim=(0.0, 1.5 * highest_mm), xlim=(0.0, delay_ms[-1]))
    axes.set_title("Tracking", fontsize=10)
    axes.legend(fontsize=8)


def _draw_sensitivity(
    axes: Axes, spec: Specification, vehicle: VehicleFile, design: Design
) -> None:
    ends_ns = (0, spec.delays_ns[-1])
    grid = frequency_grid(vehicle.models, ends_ns, spec.period_ns, _POINTS)
    law = law_response(design_law(design.settings), grid.z)
    size = sensitivity_size(grid, law)
    omega_rad_s = grid.angle_rad * NS_PER_S / spec.period_ns
    for index, colour in enumerate(_colours(vehicle)):
        axes.loglog(omega_rad_s, size[index, 0], color=colour, ls=":")
        axes.loglog(omega_rad_s, size[index, 1], color=colour)
    axes.plot([], [], color="black", ls=":", label="no delay")
    axes.plot([], [], color="black", label=f"{spec.delay.ms_max:g} ms")
    axes.axhline(spec.peak_sensitivity_max, color="black", lw=0.9, ls="--", label="limit")
    axes.set(xlabel="ω [rad/s]", ylabel="|1/(1 + L)|", ylim=(1e-3, 2.0 * spec.peak_sensitivity_max))
    axes.set_xlim(_OMEGA_RAD_S_MIN, omega_rad_s[-1])
    axes.set_title("Sensitivity", fontsize=10)
    axes.legend(fontsize=8)


def _draw_decay(axes: Axes, spec: Specification, vehicle: VehicleFile, design: Design) -> None:
    law = design_law(design.settings)
    last_ns = round(1.15 * max(design.rms.delays_ns[-1], spec.margin_delays_ns[-1]))
    delays_ns = np.linspace(0, last_ns, _DELAYS_DRAWN).astype(int)
    lags_s = [0.0] if spec.actuator is None else [0.0, spec.actuator.lag_s]
    for colour, model in zip(_colours(vehicle), vehicle.models, strict=True):
        for lag_s, style in zip(lags_s, ("-", "--"), strict=False):
            loop = SampledLoop(law, behind_lag(model, lag_s), spec.period_ns)
            decay = [loop.decay_1_s(int(delay_ns)) for delay_ns in delays_ns]
            axes.plot(delays_ns / NS_PER_MS, decay, color=colour, ls=style)
    for lag_s, style in zip(lags_s, ("-", "--"), strict=False):
        label = f"actuator lag {lag_s:g} s" if lag_s else "no actuator lag"
        axes.plot([], [], color="black", ls=style, label=label)
    settling_1_s = spec.d_stability.settling_1_s
    axes.axhline(settling_1_s, color="black", lw=0.9, ls=":", label=f"σ = {settling_1_s:g} 1/s")
    axes.axhline(0.0, color="black", lw=0.9)
    _shade_range(axes, spec)
    axes.set(xlabel="constant delay [ms]", ylabel="decay of the slowest mode [1/s]")
    axes.set(xlim=(0.0, last_ns / NS_PER_MS), ylim=(-1.5 * settling_1_s, 2.5 * settling_1_s))
    axes.set_title("Stable delays: above zero", fontsize=10)
    axes.legend(fontsize=8, loc="lower left")


def _shade_range(axes: Axes, spec: Specification) -> None:
    axes.axvspan(0.0, spec.delay.ms_max, color="0.93", zorder=0.0)


def _colours(vehicle: VehicleFile) -> list[str]:
    count = len(vehicle.box.vertices())
    return [COLOURS[index % len(COLOURS)] for index in range(count)]


def _labels(vehicle: VehicleFile) -> list[str | None]:
    """Return a label that identifies a corner; empty where there are too many."""
    corners = vehicle.box.vertices()
    if len(corners) > _CORNERS_NAMED_MAX:
        return [None] * len(corners)
    fields = [field for field, _, _ in vehicle.box.ranges]
    labels = (", ".join(f"{name} {getattr(one, name):.4g}" for name in fields) for one in corners)
    return [label or "nominal" for label in labels]
