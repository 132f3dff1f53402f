"""Profiles: how far a parameter may move, with all others sought again, before the fit is worse.

A covariance describes the cost at its minimum. Where the cost is flat, bent or ends at a limit, the
profile says what the log knows. The cost may rise by the square of the critical value, times how
much wider the errors of the model, and what is assumed, make the variance.
"""

from collections.abc import Sequence
from math import inf

import numpy as np

from .fit import Fit, Progress, quiet, refit
from .response import Grid, Samples

_DOUBLINGS = 3
_NEAR = 0.1
"""Relative error of the rise that ends a search."""


def profile(
    found: Fit, judged: tuple[Grid, Sequence[Samples]], name: str, progress: Progress = quiet
) -> tuple[float, float]:
    """Return the interval of the coordinate of a parameter, from the profile of the cost.

    An end is infinite where the cost stays flat up to its limit.
    """

    def advance(_what: str, done: int, of: int) -> None:
        progress(f"profile of {name}", done, of)

    at = found.problem.place(name)
    parameter = found.problem.parameters[at]
    spread = float(np.sqrt(found.covariance[at, at]))
    allowed = found.critical**2 * float(found.covariance[at, at] / found.bare[at, at])

    def end(sign: float) -> float:
        limit = parameter.high if sign > 0.0 else parameter.low
        step = min(found.critical * spread, 0.5 * (parameter.high - parameter.low))
        for _ in range(_DOUBLINGS):
            x = found.x[at] + sign * step
            is_limit = (x - limit) * sign >= 0.0
            x = limit if is_limit else x
            held = {name: parameter.value(x)}
            rise = refit(judged, held, found, advance).cost - found.cost
            if is_limit and rise < allowed:
                return sign * inf
            if abs(rise / allowed - 1.0) < _NEAR:
                return float(x)
            # The cost is nearly a parabola: the next step is where it would have risen enough.
            ratio = float(np.sqrt(allowed / max(rise, 1e-3 * allowed)))
            step = abs(x - found.x[at]) * min(ratio, 4.0)
        x = found.x[at] + sign * step
        return sign * inf if (x - limit) * sign >= 0.0 else float(x)

    return end(-1.0), end(1.0)
