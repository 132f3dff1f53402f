"""One control period of the moments of a jump-linear loop, compiled, in place.

Arrays have the shape (modes, states, columns). A first moment has one column, or several that do
not mix. A second moment has as many columns as states, and is moved in its rows and columns. The
states are those of ``linear_loop``: plant, law, commands with the newest first, sum, one.
"""

from typing import Any, NamedTuple

import numpy as np

from ...compiled.compilation import compiled
from ...runtime.array_types import FloatArray


class Recursion(NamedTuple):
    """The matrices of a period.

    ``decision``    (law + 1, 1 + law): the law's new states and its command, from y and the law
    ``transition``, ``hold``   of the plant over one step
    ``chosen``, ``kept``       (steps, modes): see ``jitter``
    ``held``        state that holds the command of mode 0, the youngest; each older one is next
    ``plant_end``, ``law_end``   where law and commands begin
    """

    decision: FloatArray
    transition: FloatArray
    hold: FloatArray
    chosen: FloatArray
    kept: FloatArray
    held: int
    plant_end: int
    law_end: int


@compiled
def move_first(r: Any, x: Any, driven: Any) -> None:
    """Move first moments by one period; ``driven`` (steps, plant states) is what drives it."""
    work = np.empty(len(r.decision) + len(r.hold))
    for mode in range(x.shape[0]):
        _decide_rows(r, x[mode], work)
    _age(x)
    for step in range(len(driven)):
        _choose(x, r.chosen[step], r.kept[step])
        for mode in range(x.shape[0]):
            _move_rows(r, x[mode], r.held + mode, driven[step], work)


@compiled
def move_second(r: Any, x: Any, driven: Any, noise: Any) -> None:
    """Move second moments by one period; ``noise`` is what the noise adds as the law decides."""
    work = np.empty(len(r.decision) + len(r.hold))
    one = x.shape[1] - 1
    for mode in range(x.shape[0]):
        _decide_rows(r, x[mode], work)
        _decide_rows(r, x[mode].T, work)
        probability = x[mode, one, one]
        for i in range(r.plant_end, r.law_end + 1):
            for j in range(r.plant_end, r.law_end + 1):
                x[mode, i, j] += probability * noise[i] * noise[j]
    _age(x)
    for step in range(len(driven)):
        _choose(x, r.chosen[step], r.kept[step])
        for mode in range(x.shape[0]):
            _move_rows(r, x[mode], r.held + mode, driven[step], work)
            _move_rows(r, x[mode].T, r.held + mode, driven[step], work)


@compiled
def _decide_rows(r: Any, x: Any, work: Any) -> None:
    """Apply the law's decision: its command comes first, all others get one period older."""
    start, end, last = r.plant_end, r.law_end, x.shape[0] - 3
    for i in range(last, end, -1):
        x[i] = x[i - 1]
    for column in range(x.shape[1]):
        for i in range(len(r.decision)):
            work[i] = r.decision[i, 0] * x[3, column]
            for j in range(end - start):
                work[i] += r.decision[i, 1 + j] * x[start + j, column]
        for i in range(len(r.decision)):
            x[start + i, column] = work[i]


@compiled
def _move_rows(r: Any, x: Any, held: Any, driven: Any, work: Any) -> None:
    """Move the plant by one step, the command of state ``held`` acting."""
    order, one = len(r.hold), x.shape[0] - 1
    for column in range(x.shape[1]):
        for i in range(order):
            work[i] = r.hold[i] * x[held, column] + driven[i] * x[one, column]
            for j in range(order):
                work[i] += r.transition[i, j] * x[j, column]
        for i in range(order):
            x[i, column] = work[i]


@compiled
def _age(x: Any) -> None:
    """Make every command a period older; the oldest mode keeps its moments."""
    last = x.shape[0] - 1
    if last == 0:
        return
    x[last] += x[last - 1]
    for mode in range(last - 1, 0, -1):
        x[mode] = x[mode - 1]
    x[0] = 0.0


@compiled
def _choose(x: Any, chosen: Any, kept: Any) -> None:
    """Let commands arrive: a younger one replaces any older one."""
    older = np.zeros(x.shape[1:])
    for mode in range(x.shape[0] - 1, -1, -1):
        for i in range(x.shape[1]):
            for j in range(x.shape[2]):
                value = x[mode, i, j]
                x[mode, i, j] = kept[mode] * value + chosen[mode] * older[i, j]
                older[i, j] += value
