"""Drawn cars, identified from drawn drives: how often the intervals hold the truth.

    python -m tests.searches.hidden_cars [FIRST COUNT FILE]

Two of three cars are driven as `identify` prescribes, one in ordinary traffic; of every second one
mass, geometry and steering ratio are told. The lateral acceleration comes 10 to 80 ms late. The
rows of COUNT cars are added to FILE, and all of its rows are shown.
"""

import json
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from steer_by_wire.closed_loop.identification.figures import Verdict, figure_values, figures_of
from steer_by_wire.closed_loop.identification.identified import identify
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.time_series import Channel, make_drive
from steer_by_wire.runtime.settings import SettingsError
from tests.support.runs.drawn_drives import drawn_car, log_of, normal, prescribed

OFFSET = "lateral_acceleration_m_s2:delay_s"
EXPECTED = ("understeer_gradient_rad_s2_m", "friction", "relaxation_m", "delay_and_lag_s")
"""What prescribed driving has to identify."""
Row = dict[str, Any]


def one_car(seed: int) -> Row:
    """Return the row of a car."""
    rng = np.random.default_rng(seed)
    car = drawn_car(rng)
    is_prescribed, knows = seed % 3 < 2, seed % 2 == 0
    drive = prescribed(car) if is_prescribed else normal(car, rng)
    delays_s = {"lateral_acceleration_m_s2": rng.uniform(0.01, 0.08)}
    network = rng.uniform(0.0, 0.004), rng.uniform(0.0, 0.03)
    drawn = log_of(car, *drive, rng, delays_s=delays_s, knows=knows, network=network)
    return {"seed": seed, "prescribed": is_prescribed, "knows": knows} | told(*drawn)


def told(channels: list[Channel], parameters: Mapping[str, float], known: Known) -> Row:
    """Return what a log tells: each figure with its truth."""
    try:
        found = identify(make_drive(channels, "log"), known)
    except SettingsError as error:
        return {"refused": str(error)}
    truth = figure_values(parameters)
    bounds = figures_of(found.fit._replace(covariance=found.fit.plain, critical=1.96), None)
    fisher = {one.name: one.high - one.low for one in bounds}
    figures = {
        one.name: one._asdict() | {"truth": truth[one.name], "fisher": fisher.get(one.name)}
        for one in found.figures
        if one.name in truth
    }
    return {"figures": figures, "residual_percent": found.fit.residual_percent}


def table(rows: list[Row]) -> list[str]:
    """Return misses by figure and verdict; of right intervals the band holds 99.9 % of counts."""
    lines = [f"{len(rows)} logs, {sum('refused' in row for row in rows)} refused"]
    lines += [f"  {row['seed']}: {row['refused']}" for row in rows if "refused" in row]
    counts = defaultdict[str, dict[str, list[bool]]](lambda: defaultdict(list))
    for name, one in (pair for row in rows for pair in row.get("figures", {}).items()):
        is_outside = not one["low"] <= one["truth"] <= one["high"]
        for place in (name, "all"):
            counts[place][one["verdict"]].append(is_outside)
            counts[place]["all"].append(is_outside)
    verdicts = (*Verdict, "all")
    lines.append(f"{'outside of':33}" + "".join(map("{:>20}".format, (*verdicts, "99.9 %"))))
    for name in sorted(counts, key=lambda one: one == "all"):
        cells = [counts[name][one] for one in verdicts]
        low, high = binom.interval(0.999, len(cells[-1]), 0.05)
        texts = [f"{sum(one)} of {len(one)}" for one in cells] + [f"{low:.0f} to {high:.0f}"]
        lines.append(f"{name:33}" + "".join(map("{:>20}".format, texts)))
    return lines


def summary(rows: list[Row]) -> list[str]:
    """Return what the rows show."""
    wanted = [row["figures"] for row in rows if row["prescribed"] and "figures" in row]
    good = sum(all(of[one]["verdict"] == Verdict.IDENTIFIED for one in EXPECTED) for of in wanted)
    offsets = [of[OFFSET] for of in wanted if OFFSET in of]
    near = sum(abs(one["value"] - one["truth"]) <= 0.002 for one in offsets)
    lines = [f"prescribed logs identified: {good} of {len(wanted)}"]
    lines.append(f"their offsets within 2 ms: {near} of {len(offsets)}")
    for name in EXPECTED:
        each = [of[name] for of in wanted]
        width = np.median([(one["high"] - one["low"]) / one["fisher"] for one in each])
        lines.append(f"their width of {name} over Fisher's, median: {width:.2f}")
    return [*table(rows), *lines]


def search(
    one_log: Callable[[int], Row], shown: Callable[[list[Row]], list[str]], *usual: str
) -> None:
    """Add the rows of logs to a file, and print what all of its rows show."""
    first, count, file = sys.argv[1:] or usual
    for seed in range(int(first), int(first) + int(count)):
        with Path(file).open("a", encoding="utf-8") as rows:
            print(json.dumps(one_log(seed)), file=rows)
    lines = Path(file).read_text(encoding="utf-8").splitlines()
    sys.stdout.write("\n".join(shown([*map(json.loads, lines)])) + "\n")


if __name__ == "__main__":
    search(one_car, summary, "3000", "160", "hidden_cars.jsonl")
