"""Figures 21 to 24 read with the path as the reference of (18): runs, pictures and comparisons.

A hypothesis, not a proof: the text does not say what the reference was, and has the curvature as a
disturbance for Figures 20 and 23 alone. Read with the path as the reference r, as in (18) and in
the block diagrams, Figures 21, 22 and 24 show loops without a disturbance. A sine of 1 m over 40 m
is taken; (19), whose yaw damping is misprinted in the same way, is the vehicle. All that is added
to the paper's laws is the filter of the derivative.

The nodes have no reference: their path is the zero of the lateral error. So the laws run here by
themselves, the loops of Figures 6 and 13 around (19) sampled exactly, in the order of one control
period: measure, decide, limit, hold. The reference enters the PD alone; the observers see y.

    u = C (r - y_fb) - d̂, that of the law and C r
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.pair.pair_result import rms
from ...closed_loop.reports.plot_style import law_styles
from ...controller.analysis.linear_system import held_plant
from ...controller.filters.discretization import design_pd
from ...controller.filters.nominal_model import paper_eq19
from ...controller.filters.pd_filter import pd_at_rest, pd_step
from ...controller.law_interface import LawInput
from ...controller.laws.law_from_settings import design_law
from ...controller.limits.steer_limits import limit_step
from ...controller.settings import ControllerSettings, controller_preset
from ...runtime.node import NS_PER_S
from .delay_runs import Law
from .result import CLAIM, Comparison, Picture
from .simulation import PAPER_DELAY_S, History, Quantity

AMPLITUDE_M = 1.0
WAVELENGTH_M = 40.0
SPEED_M_S = 5.0 / 3.6
DURATION_S = 60.0


def follow(controller: ControllerSettings, delay_s: float) -> History:
    """Return how a law of the paper follows the sine with a delay of the commands.

    A row a control period; the error is r - y.

    ``delay_s``  rounded to whole control periods
    """
    design, pd = design_law(controller), design_pd(controller.pd, controller.period_s)
    state, x_reference = design.initial_state(0.0), pd_at_rest(pd, 0.0)
    a, b, _, (c,), _ = held_plant(paper_eq19(), controller.period_ns, 0)
    x, steer_rad = np.zeros(len(b)), 0.0
    on_their_way = deque([0.0] * round(delay_s * NS_PER_S / controller.period_ns))
    time_s = controller.period_s * np.arange(round(DURATION_S / controller.period_s))
    reference_m = AMPLITUDE_M * np.sin(2.0 * np.pi * SPEED_M_S / WAVELENGTH_M * time_s)
    rows = []
    for wanted_m in reference_m.tolist():
        y_m = float(c @ x)
        state, output = design.step(design.params, state, LawInput(y_m, steer_rad))
        x_reference, reference_rad = pd_step(pd, x_reference, -wanted_m)
        demand_rad = output.steer_rad + reference_rad
        steer_rad = limit_step(controller.steer_limits, steer_rad, demand_rad)
        rows.append((wanted_m - y_m, steer_rad))
        on_their_way.append(steer_rad)
        x = a @ x + b * on_their_way.popleft()
    error_m, sent_rad = np.array(rows, dtype=np.float64).T
    return History(np.asarray(time_s, dtype=np.float64), error_m, sent_rad)


READING = "path as the reference"
FILTERS_RAD_S = (15.0, 30.0)
CAPTION = (
    f"Second, the path read as the reference of (18): a sine of {AMPLITUDE_M:g} m over"
    f" {WAVELENGTH_M:g} m at 5 km/h, {DURATION_S:g} s, no curvature as a disturbance, (19) itself"
    " as the vehicle, 80 ms; the error is r - y."
)
WHY = (
    " With the path as the reference r, as in (18) and the block diagrams, and (19) itself as the"
    " vehicle, the statement holds with a filtered derivative and the laws as published. That the"
    " authors did so is a hypothesis: the text has neither the reference nor a value of the curves."
)
_STEP = 50
"""Rows of a picture: one in so many control periods."""


JudgeReading = Callable[[str, Quantity, Sequence[Law]], list[Comparison]]


def smaller(statement: str, quantity: Quantity, laws: Sequence[Law]) -> list[Comparison]:
    """Return whether the second law has the smaller RMS, for each filter."""
    return _compared(statement, quantity, laws, lambda first, second: second < first)


def alike(statement: str, quantity: Quantity, laws: Sequence[Law]) -> list[Comparison]:
    """Return whether the RMS of the two laws differ by less than a tenth, for each filter."""
    return _compared(statement, quantity, laws, lambda a, b: abs(b - a) < 0.1 * a)


def picture(name: str, quantity: Quantity, laws: Sequence[Law]) -> Picture:
    """Draw a quantity of two laws on the reference, a panel for each filter."""
    figure = Figure(figsize=(10.5, 4.2))
    for axes, filter_rad_s in zip(
        figure.subplots(1, len(FILTERS_RAD_S), sharey=True), FILTERS_RAD_S, strict=True
    ):
        for style, law in zip(law_styles(law.name for law in laws), laws, strict=True):
            run = _run(law, filter_rad_s)
            time_s, values = run.time_s, quantity.of(run)
            text = f"{law.label}, RMS {rms(values):.3g}"
            axes.plot(time_s[::_STEP], values[::_STEP], lw=0.9, label=text, **style)
        axes.set(xlabel="time [s]")
        axes.set_title(f"Path as the reference, N = {filter_rad_s:g} rad/s", fontsize=10.5)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    figure.axes[0].set_ylabel(f"{quantity.label} [{quantity.unit}]")
    return Picture(name, figure)


def _compared(
    statement: str, quantity: Quantity, laws: Sequence[Law], holds: Callable[[float, float], bool]
) -> list[Comparison]:
    compared = []
    for filter_rad_s in FILTERS_RAD_S:
        what = f"RMS {quantity.name}, {READING}, N = {filter_rad_s:g} rad/s"
        values = {law.label: rms(quantity.of(_run(law, filter_rad_s))) for law in laws}
        texts = (f"{label}: {value:.4f} {quantity.unit}" for label, value in values.items())
        is_held = holds(*values.values())
        compared.append(Comparison(what, statement, "; ".join(texts), is_held, CLAIM, READING))
    return compared


@cache
def _run(law: Law, filter_rad_s: float) -> History:
    override = f"pd.derivative_filter_rad_s={filter_rad_s}"
    return follow(controller_preset(law.preset, (override,)), PAPER_DELAY_S)
