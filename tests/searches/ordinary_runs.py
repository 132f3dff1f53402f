"""Count false alarms of the watch on signals and of the model's fit in ordinary runs.

    python -m tests.searches.ordinary_runs [RUNS SEED]

A run in virtual time is one of ``tests.controller.node.test_plausibility``: a preset, a vehicle of
its box, network, noise, side wind and an offset; here also on a drawn path. Prints every alarm, and
their count with the interval of Clopper and Pearson; ends with status 1 if there is one. It drives
1000 runs with seed 1 if no words say otherwise, which takes about twenty CPU minutes.
"""

import sys
from typing import Any

import numpy as np
from scipy.stats import binomtest

from steer_by_wire import simulate
from tests.controller.node.test_plausibility import ordinary

DURATION_S = 12.0


def path_of(rng: np.random.Generator, *, is_fast: bool) -> dict[str, Any]:
    """Draw a path that suits walking speed, or 60 km/h."""
    least_m = 150.0 if is_fast else 15.0
    kinds = {
        "straight": {},
        "circle": {"radius_m": rng.uniform(1.0, 4.0) * least_m},
        "ellipse": {"semi_major_axis_m": 6.0 * least_m, "semi_minor_axis_m": 4.0 * least_m},
        "single_lane_change": {
            "start_m": 0.1 * least_m,
            "offset_m": rng.uniform(1.0, 3.5),
            "length_m": rng.uniform(0.6, 1.0) * least_m,
        },
    }
    kind = str(rng.choice(list(kinds)))
    return {"plant.path": {"kind": kind, **kinds[kind]}}


def alarm_in(seed: int) -> str:
    """Drive one run; returns its alarms in words, empty for none."""
    plant, preset, overrides = ordinary(seed)
    rng = np.random.default_rng([40, 9, seed])
    if rng.random() < 0.6:
        overrides |= path_of(rng, is_fast=plant.startswith("highway"))
    run = simulate(plant, preset, seed=seed, duration_s=DURATION_S, overrides=overrides)
    report = run.controller_report
    misfit = "" if report["model"]["fits"] else f"does not fit: {report['model']}"
    if alarms := "; ".join(filter(None, (report["contradiction"], misfit))):
        return f"{seed} {preset}, {run.outcome}: {alarms}: {overrides}"
    return ""


def main() -> int:
    """Drive the runs; returns 1 if one raised an alarm."""
    runs, seed = map(int, sys.argv[1:] or ("1000", "1"))
    alarms = 0
    for number in range(runs):
        alarm = alarm_in(1_000_000 * seed + number)
        alarms += bool(alarm)
        sys.stdout.write(f"{alarm}\n" if alarm else "")
        if (number + 1) % 50 == 0:
            sys.stderr.write(f"{number + 1} runs, {alarms} with an alarm\n")
    low, high = binomtest(alarms, runs).proportion_ci(method="exact")
    sys.stdout.write(f"alarms in {alarms} of {runs} runs ({low:.2%} to {high:.2%})\n")
    return int(alarms > 0)


if __name__ == "__main__":
    sys.exit(main())
