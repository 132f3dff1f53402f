"""Figures 21 to 24 read with the path as the reference of (18): pictures and comparisons.

A hypothesis, not a proof: the text does not say what the reference was. A sine of 1 m over 40 m is
taken; (19), whose yaw damping is misprinted in the same way, is the vehicle. All that is added to
the paper's laws is the filter of the derivative.
"""

from collections.abc import Callable
from functools import cache

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

Column = Callable[[Followed], FloatArray]


def error_m(run: Followed) -> FloatArray:
    """Return r - y."""
    return run.error_m


def steer_rad(run: Followed) -> FloatArray:
    """Return the steering angle."""
    return run.steer_rad


def steer_rate_rad_s(run: Followed) -> FloatArray:
    """Return the steering rate, which "speed" in Figure 24 may be."""
    return run.steer_rate_rad_s


def smaller(
    statement: str, quantity: str, unit: str, of: Column, laws: tuple[Law, Law]
) -> tuple[Comparison, ...]:
    """Return whether the second law has the smaller RMS, for each filter."""
    return tuple(
        _comparison(statement, quantity, unit, of, laws, filter_rad_s, lambda a, b: b < a)
        for filter_rad_s in FILTERS_RAD_S
    )


def alike(
    statement: str, quantity: str, unit: str, of: Column, laws: tuple[Law, Law]
) -> tuple[Comparison, ...]:
    """Return whether the RMS of the two laws differ by less than a tenth, for each filter."""
    return tuple(
        _comparison(
            statement, quantity, unit, of, laws, filter_rad_s, lambda a, b: abs(b - a) < 0.1 * a
        )
        for filter_rad_s in FILTERS_RAD_S
    )


def picture(name: str, label: str, of: Column, laws: tuple[Law, Law]) -> Picture:
    """Draw a column of two laws on the reference, a panel for each filter."""
    figure = Figure(figsize=(10.5, 4.2))
    columns: dict[str, FloatArray] = {}
    for axes, filter_rad_s in zip(
        figure.subplots(1, len(FILTERS_RAD_S), sharey=True), FILTERS_RAD_S, strict=True
    ):
        for colour, law in zip(COLOURS, laws, strict=False):
            run = _run(law, filter_rad_s)
            columns["time_s"] = run.time_s[::_STEP]
            columns[f"N {filter_rad_s:g} rad/s: {law.label}"] = of(run)[::_STEP]
            text = f"{law.label}, RMS {rms(of(run)):.3g}"
            axes.plot(run.time_s[::_STEP], of(run)[::_STEP], color=colour, lw=0.9, label=text)
        axes.set(xlabel="time [s]")
        axes.set_title(f"Path as the reference, N = {filter_rad_s:g} rad/s", fontsize=10.5)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    figure.axes[0].set_ylabel(label)
    return Picture(name, figure, columns)


def _comparison(
    statement: str,
    quantity: str,
    unit: str,
    of: Column,
    laws: tuple[Law, Law],
    filter_rad_s: float,
    holds: Callable[[float, float], bool],
) -> Comparison:
    values = [rms(of(_run(law, filter_rad_s))) for law in laws]
    return Comparison(
        f"RMS {quantity}, {READING}, N = {filter_rad_s:g} rad/s",
        statement,
        "; ".join(
            f"{law.label}: {value:.4f} {unit}" for law, value in zip(laws, values, strict=True)
        ),
        holds(values[0], values[1]),
        CLAIM,
        READING,
    )


@cache
def _run(law: Law, filter_rad_s: float) -> Followed:
    override = f"pd.derivative_filter_rad_s={filter_rad_s}"
    return follow(controller_preset(law.preset, (override,)), PAPER_DELAY_S)


PD_TO_CDOB = (PD, CDOB)
CDOB_TO_DDOB = (CDOB, DDOB)
