"""Figures 21 to 24 read with the path as the reference of (18): pictures and comparisons.

A hypothesis, not a proof: the text does not say what the reference was. A sine of 1 m over 40 m is
taken; (19), whose yaw damping is misprinted in the same way, is the vehicle. All that is added to
the paper's laws is the filter of the derivative.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from matplotlib.figure import Figure

from ...controller.settings import controller_preset
from ...pair.trace import rms
from ...reports.plot_style import COLOURS
from ...runtime.array_types import FloatArray
from .delay_runs import CDOB, DDOB, PD, Law
from .reference_runs import AMPLITUDE_M, DURATION_S, WAVELENGTH_M, Followed, follow
from .result import CLAIM, Comparison, Picture
from .simulation import PAPER_DELAY_S

READING = "path as the reference"
FILTERS_RAD_S = (15.0, 30.0)
CAPTION = (
    f"Beside it, the path read as the reference of (18): a sine of {AMPLITUDE_M:g} m over"
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


class Quantity(NamedTuple):
    """A column of ``Followed``, and what it is called."""

    name: str
    unit: str
    column: str


ERROR = Quantity("error", "m", "error_m")
STEER = Quantity("steer", "rad", "steer_rad")
STEER_RATE = Quantity("steering rate", "rad/s", "steer_rate_rad_s")
"""What "speed" in Figure 24 may be."""


def smaller(statement: str, quantity: Quantity, laws: tuple[Law, Law]) -> list[Comparison]:
    """Return whether the second law has the smaller RMS, for each filter."""
    return _compared(statement, quantity, laws, lambda first, second: second < first)


def alike(statement: str, quantity: Quantity, laws: tuple[Law, Law]) -> list[Comparison]:
    """Return whether the RMS of the two laws differ by less than a tenth, for each filter."""
    return _compared(statement, quantity, laws, lambda a, b: abs(b - a) < 0.1 * a)


def picture(name: str, label: str, quantity: Quantity, laws: tuple[Law, Law]) -> Picture:
    """Draw a quantity of two laws on the reference, a panel for each filter."""
    figure = Figure(figsize=(10.5, 4.2))
    columns: dict[str, FloatArray] = {}
    for axes, filter_rad_s in zip(
        figure.subplots(1, len(FILTERS_RAD_S), sharey=True), FILTERS_RAD_S, strict=True
    ):
        for colour, law in zip(COLOURS, laws, strict=False):
            time_s, values = _run(law, filter_rad_s).time_s, _values(law, filter_rad_s, quantity)
            columns["time_s"] = time_s[::_STEP]
            columns[f"N {filter_rad_s:g} rad/s: {law.label}"] = values[::_STEP]
            text = f"{law.label}, RMS {rms(values):.3g}"
            axes.plot(time_s[::_STEP], values[::_STEP], color=colour, lw=0.9, label=text)
        axes.set(xlabel="time [s]")
        axes.set_title(f"Path as the reference, N = {filter_rad_s:g} rad/s", fontsize=10.5)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    figure.axes[0].set_ylabel(label)
    return Picture(name, figure, columns)


def _compared(
    statement: str,
    quantity: Quantity,
    laws: tuple[Law, Law],
    holds: Callable[[float, float], bool],
) -> list[Comparison]:
    compared = []
    for filter_rad_s in FILTERS_RAD_S:
        what = f"RMS {quantity.name}, {READING}, N = {filter_rad_s:g} rad/s"
        first, second = (rms(_values(law, filter_rad_s, quantity)) for law in laws)
        texts = (
            f"{law.label}: {value:.4f} {quantity.unit}"
            for law, value in zip(laws, (first, second), strict=True)
        )
        is_held = holds(first, second)
        compared.append(Comparison(what, statement, "; ".join(texts), is_held, CLAIM, READING))
    return compared


def _values(law: Law, filter_rad_s: float, quantity: Quantity) -> FloatArray:
    values: FloatArray = getattr(_run(law, filter_rad_s), quantity.column)
    return values


@cache
def _run(law: Law, filter_rad_s: float) -> Followed:
    override = f"pd.derivative_filter_rad_s={filter_rad_s}"
    return follow(controller_preset(law.preset, (override,)), PAPER_DELAY_S)


PD_TO_CDOB = (PD, CDOB)
CDOB_TO_DDOB = (CDOB, DDOB)
