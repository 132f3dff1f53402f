"""Runs of many feedback loops at once, one a column: friction, a patch of ice, jitter, passivity.

The loop is that of ``scripting.feedback``, a cycle a step. Wheels without hands are kicked, and are
still again at the end or not. A passivity controller damps as in ``feedback_laws.resist``.
"""

from collections.abc import Sequence
from itertools import chain, product
from math import inf, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steer_by_wire.hand_wheel.analysis.sampled_laws import zero_order_hold
from steer_by_wire.tools.feedback.frontier import (
    BAND_RAD_S,
    GRADIENT_FACTORS,
    JITTER,
    ROUND_TRIPS_S,
    Bench,
    Design,
    Point,
    best_points,
    passivity_controllers,
)

DURATION_S = 14.0
KICK_RAD_S = 8.0
"""Rate after a kick of 3 N m for a tenth of a second."""
ICE_S, ICE_GRIP = (4.0, 6.0), 0.3
FRICTION_N_M = 0.3
"""Chosen: what hides a slow oscillation of small size."""
CONDITIONS = ("friction", "ice", "jitter")
SEED = 61
_STILL = 0.1
"""Swing at the end over that before, at most."""
_WINDOW_S = 3.0
_MOVED_S = 24.0
Matrix = NDArray[np.float64]


class Column(NamedTuple):
    """One loop of a batch; ``condition`` is one of CONDITIONS or empty."""

    design: Design
    factor: float
    round_trip_s: float
    condition: str = ""


def frontier(bench: Bench) -> list[Point]:
    """Return the best of every law at each round trip; ``fails`` where no settings hold a run."""
    groups = list(best_points(bench))
    columns = [
        Column(point.design, GRADIENT_FACTORS[-1], point.round_trip_s, condition)
        for point in chain(*groups)
        if point.design is not None
        for condition in CONDITIONS
    ]
    still = iter(settle(bench, columns))
    found = []
    for group in groups:
        run = [
            point._replace(fails=tuple(each for each in CONDITIONS if not next(still)))
            for point in group
            if point.design is not None
        ]
        found.append(min(run or group, key=lambda point: (len(point.fails), point.changed)))
    return found + _passivity_points(bench)


def _passivity_points(bench: Bench) -> list[Point]:
    designs = list(passivity_controllers(bench))
    shape = len(designs), len(GRADIENT_FACTORS), len(ROUND_TRIPS_S)
    columns = [Column(*case) for case in product(designs, GRADIENT_FACTORS, ROUND_TRIPS_S)]
    everywhere = [each._replace(condition=c) for c in ("", *CONDITIONS) for each in columns]
    is_still = np.reshape(settle(bench, everywhere), (-1, *shape)).all(axis=(0, 2))
    worst = np.reshape(changed_in_runs(bench, columns), shape).max(axis=1)
    changed = np.where(is_still, worst, inf)
    found = []
    for trip, at_s in enumerate(ROUND_TRIPS_S):
        best = int(changed[:, trip].argmin())
        error = float(changed[best, trip])
        known = () if error == inf else (error, 0.5 * at_s, nan, designs[best])
        found.append(Point("passivity controller", at_s, *known))
    return found


class _Batch:
    """The loops of columns, padded to one size."""

    def __init__(self, bench: Bench, columns: Sequence[Column]) -> None:
        loops = [bench.loop(each.design, each.factor) for each in columns]
        on_ice = [
            bench.loop(each.design, each.factor, ICE_GRIP if each.condition == "ice" else 1.0)
            for each in columns
        ]
        size, laws = max(len(loop.g) for loop in loops), [each.design.law for each in columns]
        order = len(bench.held.b)
        self.f, self.f_on_ice = (_padded([x.f for x in each], size) for each in (loops, on_ice))
        self.g = _padded([loop.g for loop in loops], size)
        self.h = _padded([loop.h for loop in loops], size)
        local = [
            np.concatenate(([law.d[0]], np.zeros(len(loop.g) - len(law.c) - 1), law.c))
            for loop, law in zip(loops, laws, strict=True)
        ]
        self.local, self.by_road = _padded(local, size), np.array([law.d[1] for law in laws])
        of_torque = zero_order_hold(bench.held, bench.cycle_s).b
        self.of_torque = np.concatenate((of_torque, np.zeros(size - order)))
        self.cycles = np.array([round(each.round_trip_s / bench.cycle_s) for each in columns])
        conditions = np.array([each.condition for each in columns])
        self.jitter = np.where(conditions == "jitter", np.ceil(JITTER * self.cycles), 0.0)
        friction_n_m = np.where(conditions == "friction", FRICTION_N_M, 0.0)
        self.stops_rad_s = friction_n_m * bench.cycle_s / bench.wheel.inertia_kg_m2
        self.least, self.passive = np.array([each.design.passive_n_m_s for each in columns]).T


def settle(bench: Bench, columns: Sequence[Column]) -> list[bool]:
    """Return of each loop whether its wheel, kicked once, is still again at the end."""
    angles = _run(bench, columns, DURATION_S, moved=False)[0]
    window = round(_WINDOW_S / bench.cycle_s)
    first, last = np.ptp(angles[:window], axis=0), np.ptp(angles[-window:], axis=0)
    return [bool(end < _STILL * start) for start, end in zip(first, last, strict=True)]


def changed_in_runs(bench: Bench, columns: Sequence[Column]) -> list[float]:
    """Return of each law the error of the felt torque while the wheel is moved, as a share."""
    _, felt, ideal = _run(bench, columns, _MOVED_S, moved=True)
    half = len(felt) // 2
    error, own = (np.mean(each[half:] ** 2, axis=0) for each in (felt - ideal, ideal))
    return [float(share) for share in np.sqrt(error / own)]


def _run(
    bench: Bench, columns: Sequence[Column], duration_s: float, *, moved: bool
) -> tuple[Matrix, Matrix, Matrix]:
    """Return angles, felt torques and the road's own; ``moved`` by a hand, or kicked once."""
    batch, cycle_s, number = _Batch(bench, columns), bench.cycle_s, np.arange(len(columns))
    steps, rng = round(duration_s / cycle_s), np.random.default_rng(SEED)
    angles, felt, sent = (np.zeros((steps, len(columns))) for _ in range(3))
    x, energy_j = np.zeros_like(batch.g), np.zeros(len(columns))
    x[:, 1] = 0.0 if moved else KICK_RAD_S
    ice = range(*(round(at_s / cycle_s) for at_s in ICE_S))
    phases = np.arange(len(BAND_RAD_S)) ** 2.0
    for step in range(steps):
        if moved:
            turns = BAND_RAD_S * step * cycle_s + phases
            x[:, 0], x[:, 1] = np.sin(turns).sum(), (BAND_RAD_S * np.cos(turns)).sum()
        angles[step], sent[step] = x[:, 0], (batch.h * x).sum(axis=1)
        came = step - batch.cycles - np.floor(rng.random() * (batch.jitter + 1.0)).astype(int)
        arrived = np.where(came >= 0, sent[came, number], 0.0)
        local_n_m = (batch.local * x).sum(axis=1)
        felt[step] = local_n_m + batch.by_road * arrived
        f = batch.f_on_ice if step in ice and not moved else batch.f
        x = np.matmul(f, x[:, :, np.newaxis])[:, :, 0] + batch.g * arrived[:, np.newaxis]
        # The passivity controller: the rate is that of the filter, by its torque.
        rate_rad_s = local_n_m / batch.least
        squared_s = np.maximum(rate_rad_s**2 * cycle_s, 1e-12)
        energy_j += felt[step] * rate_rad_s * cycle_s
        damping = np.minimum(np.maximum(-energy_j, 0.0) / squared_s, batch.passive)
        energy_j += damping * squared_s
        felt[step] += damping * rate_rad_s
        x += np.outer(damping * rate_rad_s, batch.of_torque)
        stopped_rad_s = np.clip(x[:, 1], -batch.stops_rad_s, batch.stops_rad_s)
        x[:, 1] -= stopped_rad_s
        x[:, 0] -= 0.5 * cycle_s * stopped_rad_s
    return angles, felt, sent


def _padded(parts: Sequence[Matrix], size: int) -> Matrix:
    return np.stack([np.pad(part, [(0, size - len(part))] * part.ndim) for part in parts])
