"""The swing that a hand wheel's friction holds: ``friction_threshold`` against runs.

    python -m tests.searches.friction_holds [LOOPS [FIRST]]

Each loop is one of ``feedback_boundaries`` with a drawn torque gradient and friction, for which a
swing is computed. The kick between a run that ends still and one that shakes is bisected. Both then
swing alike, until one dies down and the other grows: their swing at that time is the real one.
Prints every loop, and quantiles of real over computed with 95 % of their bootstrap.
"""

import sys
from collections.abc import Iterator
from itertools import count, islice
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from steer_by_wire.closed_loop.compiled.hand_wheel import Wheel, shaking_of
from steer_by_wire.closed_loop.scripting.feedback import Threshold, friction_threshold
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.searches.feedback_boundaries import SEED, Loop, drawn, run, settings_of

DURATION_S = 40.0
KICKS_N_M = (0.01, 5.0)
PARTED = 0.1
"""Difference of two runs, over their swing."""


class Held(NamedTuple):
    """A loop with friction, and the swing that it is said to hold."""

    loop: Loop
    gradient_n_m: float
    friction_n_m: float
    computed: Threshold

    def settings(self, kick_n_m: float = 1.0) -> tuple[PlantSettings, HandWheelSettings]:
        return settings_of(self.loop, self.gradient_n_m, kick_n_m, self.friction_n_m)

    def run(self, kick_n_m: float) -> Wheel:
        return run(*self.settings(kick_n_m), DURATION_S)


def held_loops(first: int = 0) -> Iterator[tuple[int, Held]]:
    """Yield the drawn loops in which friction is said to hold a swing, each with its number."""
    for number in count(first):
        rng = np.random.default_rng([SEED, number, 1])
        gradient, friction = np.exp(rng.uniform(np.log([1.0, 0.05]), np.log([60.0, 0.6]))).tolist()
        loop = drawn(number)
        pair = settings_of(loop, gradient, friction_n_m=friction)
        round_trip_s = (loop.down + loop.up) * loop.cycle_ms / 1e3
        if (computed := friction_threshold(*pair, round_trip_s)) is not None:
            yield number, Held(loop, gradient, friction, computed)


def real_swing_rad(held: Held) -> float | None:
    """Return the swing at which runs that shake and that end still part; None where all do one."""
    kicks = np.log(KICKS_N_M)
    still, shakes = map(held.run, KICKS_N_M)
    if shaking_of(still) is not None or shaking_of(shakes) is None:
        return None
    for _ in range(20):
        done = held.run(float(np.exp(kicks.mean())))
        if shaking_of(done) is None:
            kicks[0], still = kicks.mean(), done
        else:
            kicks[1], shakes = kicks.mean(), done
    period = round(1e3 / held.loop.cycle_ms / held.computed.frequency_hz)
    pair = np.array([done.samples[0, : still.cycles_done] for done in (still, shakes)])
    swings_rad = 0.5 * np.ptp(sliding_window_view(pair.mean(axis=0), period), axis=1)
    apart_rad = np.abs(np.diff(pair, axis=0)[0, period - 1 :])
    return float(swings_rad[np.flatnonzero(apart_rad > PARTED * swings_rad)[0]])


def main(arguments: list[str]) -> None:
    loops, first = map(int, [*arguments, *("120", "0")[len(arguments) :]])
    ratios = []
    for number, held in islice(held_loops(first), loops):
        real_rad, computed_rad = real_swing_rad(held), held.computed.amplitude_rad
        ratios += [] if real_rad is None else [real_rad / computed_rad]
        sys.stdout.write(
            f"{number}: computed {computed_rad:.3g} rad, real {real_rad or nan:.3g}: {held}\n"
        )
    again = np.random.default_rng(SEED).choice(ratios, (2000, len(ratios)))
    for share in (0.05, 0.25, 0.5, 0.75, 0.95, 1.0):
        low, high = np.quantile(np.quantile(again, share, axis=1), (0.025, 0.975))
        value = np.quantile(ratios, share)
        sys.stdout.write(f"real/computed, {share:.0%}: {value:.2f} ({low:.2f} to {high:.2f})\n")


if __name__ == "__main__":
    main(sys.argv[1:])
