"""Figures 10 and 11 of SAE 2018-01-1086: |y/r| at the vertices.

    Figure 10    y/r = C G/(1 + C G)                        without DOB
    Figure 11    y/r = C M/(1 + C M),  M = y/u_new          with DOB, (12)

"It can be seen that at low frequency there are larger variations in figure 10." The variation with
the vehicle is examined in two places: y/r of the closed loop, which two integrators hold at 1 for
ω towards 0 whatever the vehicle, and y/u_new, which is G without DOB. No delay, no sampling.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ....controller.filters.continuous_filters import pd_compensator, q_order_2
from ....controller.filters.nominal_model import paper_eq19
from ....controller.laws.law_from_settings import required
from ....runtime.array_types import FloatArray
from ..corners import corner_labels, corner_plants, published_law
from ..result import Comparison, Picture, Reproduction, Verdict
from ..small_gain import on_axis

CUTOFF_RAD_S = 5.0
"""ω_c of the DOB, section VI.B.1."""
SPREAD_AT_RAD_S = 0.1
_OMEGA_RAD_S = np.geomspace(1e-2, 1e3, 2001)


class CornerResponses(NamedTuple):
    """Magnitudes at the four vertices over _OMEGA_RAD_S, shape (4, Z)."""

    closed_loop: FloatArray  # y/r
    regulated: FloatArray  # y/u_new


def spread(size: FloatArray) -> FloatArray:
    """Return largest over smallest of the vertices at each ω, from 1."""
    return np.asarray(size.max(axis=0) / size.min(axis=0))


def figure_10() -> Reproduction:
    """Return |y/r| at the four vertices without DOB, and how far it spreads."""
    responses = corner_responses("pd")
    return Reproduction(
        key="figure_10",
        title="|y/r| at the four vertices, without DOB",
        caption="PD with K_p = 1.0596, K_d = 0.939 and ideal derivative; (4) with C_r = 500,000"
        " N/rad and l_s = 2 m. Below: the vehicle itself, |y/u|.",
        pictures=(_response_picture("figure_10", responses, "y/u"),),
        comparisons=(),
        verdict=Verdict.WITH_CORRECTION,
        why="The curves spread as the text says, with C_r and l_s corrected. But in |y/r| as"
        " plotted the spread vanishes towards ω = 0, where two integrators hold y/r at 1 whatever"
        " the vehicle. What the text says of low ω is plain in y/u: there the spread is largest,"
        " nearly (7/4)² since the steady gain of (4) is about V²/(l_f + l_r).",
    )


def figure_11() -> Reproduction:
    """Return |y/r| at the four vertices with DOB, and the spread next to that of Figure 10."""
    both = corner_responses("pd"), corner_responses("pd_dob")
    closed, plant = (
        [float(np.interp(SPREAD_AT_RAD_S, _OMEGA_RAD_S, spread(size))) for size in sizes]
        for sizes in zip(*both, strict=True)
    )
    return Reproduction(
        key="figure_11",
        title="|y/r| at the four vertices, with DOB",
        caption="As Figure 10, with the DOB of (11): G_n of (19), Q of (20), ω_c = 5 rad/s. Below:"
        " the regulated vehicle, |y/u_new| of (12).",
        pictures=(_response_picture("figure_11", both[1], "y/u_new"),),
        comparisons=(
            _smaller(f"spread of |y/r| at {SPREAD_AT_RAD_S} rad/s", *closed, digits=4),
            _smaller(f"spread of |y/u_new| at {SPREAD_AT_RAD_S} rad/s", *plant, digits=3),
        ),
        verdict=Verdict.WITH_CORRECTION,
        why="With C_r and l_s corrected the curves lie closer together at low ω with the DOB, in"
        " y/r and more plainly in y/u_new. It helps below its cutoff: towards ω_c, where 1 - Q is"
        " no longer small, the spread is as large as without.",
    )


def corner_responses(law: str) -> CornerResponses:
    """Return |y/r| and |y/u_new| of a published law, pd or pd_dob, at the vertices, no delay."""
    settings = published_law(law)
    s = on_axis(_OMEGA_RAD_S)
    compensator = pd_compensator(required(settings.pd)).response(s)
    regulated = np.array([plant.response(s) for plant in corner_plants()])
    if settings.dob is not None:  # (12)
        q, model = q_order_2(settings.dob.q_cutoff_rad_s).response(s), paper_eq19().response(s)
        regulated = model * regulated / (regulated * q + model * (1.0 - q))
    loops = compensator * regulated
    return CornerResponses(np.abs(loops / (1.0 + loops)), np.abs(regulated))


def _decibels(ratio: float) -> float:
    return float(20.0 * np.log10(ratio))


def _smaller(what: str, without: float, with_dob: float, *, digits: int) -> Comparison:
    return Comparison(
        f"{what}, without and with DOB",
        "smaller with DOB",
        f"{_decibels(without):.{digits}f} and {_decibels(with_dob):.{digits}f} dB",
        with_dob < without,
    )


def _response_picture(name: str, responses: CornerResponses, inner: str) -> Picture:
    figure = Figure(figsize=(8.0, 7.2))
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_corners(upper, responses.closed_loop)
    _draw_corners(lower, responses.regulated)
    upper.set(ylabel="|y/r| [dB]", title="Closed loop, y/r")
    lower.set(ylabel=f"|{inner}| [dB, m/rad]", xlabel="ω [rad/s]")
    lower.set(title=f"What the PD acts on, {inner}")
    upper.legend(loc="lower left")
    return Picture(name, figure)


def _draw_corners(axes: Axes, sizes: FloatArray) -> None:
    for label, size in zip(corner_labels(), sizes, strict=True):
        axes.semilogx(_OMEGA_RAD_S, 20.0 * np.log10(size), label=label)
    axes.axvline(CUTOFF_RAD_S, color="0.4", lw=0.9, ls="-.")
    axes.margins(x=0.0)
