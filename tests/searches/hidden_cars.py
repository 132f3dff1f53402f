"""Drawn cars, identified from drawn drives: how often the intervals hold the truth.

    python -m tests.searches.hidden_cars --first 0 --count 40 --rows out/hidden_cars.jsonl

Two of three cars are driven as `identify` prescribes, one in ordinary traffic; of every second one
mass, geometry and steering ratio are told. The lateral acceleration comes 10 to 80 ms late. Rows
are added to a file, and the summary is of all rows in it.
"""

import argparse
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from steer_by_wire.closed_loop.identification.figures import Verdict, figure_values, figures_of
from steer_by_wire.closed_loop.identification.identified import identify
from steer_by_wire.closed_loop.identification.time_series import make_drive
from steer_by_wire.runtime.settings import SettingsError
from tests.support.runs.drawn_drives import drawn_car, log_of, normal, prescribed

OFFSET = "lateral_acceleration_m_s2:delay_s"
EXPECTED = ("understeer_gradient_rad_s2_m", "friction", "relaxation_m", "delay_and_lag_s")
"""What prescribed driving has to identify."""


def one_car(seed: int) -> dict[str, Any]:
    """Return the row of a car."""
    rng = np.random.default_rng(seed)
    car = drawn_car(rng)
    is_prescribed, knows = seed % 3 < 2, seed % 2 == 0
    drive = prescribed(car) if is_prescribed else normal(car, rng)
    delays_s = {"lateral_acceleration_m_s2": float(rng.uniform(0.01, 0.08))}
    network = float(rng.uniform(0.0, 0.004)), float(rng.uniform(0.0, 0.03))
    drawn = log_of(car, *drive, rng, delays_s=delays_s, knows=knows, network=network)
    row: dict[str, Any] = {"seed": seed, "prescribed": is_prescribed, "knows": knows}
    try:
        found = identify(make_drive(drawn.channels, f"car {seed}"), drawn.known)
    except SettingsError as error:
        return row | {"refused": str(error)}
    truth = figure_values(drawn.truth)
    fisher = found.fit._replace(covariance=found.fit.plain, critical=1.96)
    bounds = figures_of(fisher, None)
    row["figures"] = {
        one.name: {
            "truth": truth[one.name],
            **one._asdict(),
            "fisher": bound.high - bound.low,
        }
        for one, bound in zip(found.figures, bounds, strict=False)
        if one.name in truth
    }
    return row


def summary(rows: list[dict[str, Any]]) -> list[str]:
    """Return what the rows show; beside each count that of a right interval in 99.9 % of cases."""
    whole = [row for row in rows if "figures" in row]
    lines = [f"{len(rows)} cars, {len(rows) - len(whole)} refused"]
    lines += [f"  {row['seed']}: {row['refused']}" for row in rows if "refused" in row]
    names = defaultdict[str, list[Any]](list)
    for row in whole:
        for name, one in row["figures"].items():
            names[name].append((row, one))
    lines.append(
        f"{'figure':36} {'held':>9} {'99.9 %':>11} {'identified':>10}"
        f" {'width/Fisher, prescribed':>25}"
    )
    for name, found in names.items():
        held = sum(one["low"] <= one["truth"] <= one["high"] for _, one in found)
        sure = sum(one["verdict"] == Verdict.IDENTIFIED for _, one in found)
        widths = [
            (one["high"] - one["low"]) / one["fisher"] for row, one in found if row["prescribed"]
        ]
        width = f"{np.median(widths):25.2f}" if widths else ""
        low, high = binom.interval(0.999, len(found), 0.95)
        band = f"{low:.0f} to {high:.0f}"
        lines.append(f"{name:36} {held:4} /{len(found):3} {band:>11} {sure:10} {width}")
    wanted = [row for row in whole if row["prescribed"]]
    good = sum(
        all(row["figures"][name]["verdict"] == Verdict.IDENTIFIED for name in EXPECTED)
        for row in wanted
    )
    lines.append(f"prescribed logs identified: {good} of {len(wanted)}")
    offsets = [row["figures"][OFFSET] for row in wanted if OFFSET in row["figures"]]
    near = sum(abs(one["value"] - one["truth"]) <= 0.002 for one in offsets)
    lines.append(
        f"offset within 2 ms: {near} of {len(offsets)}; not told {len(wanted) - len(offsets)}"
    )
    return lines


def main(arguments: list[str]) -> None:
    """Identify cars and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--rows", type=Path, default=Path("hidden_cars.jsonl"))
    options = parser.parse_args(arguments)
    with options.rows.open("a", encoding="utf-8") as file:
        for seed in range(options.first, options.first + options.count):
            print(json.dumps(one_car(seed)), file=file, flush=True)
    rows = [json.loads(line) for line in options.rows.read_text(encoding="utf-8").splitlines()]
    sys.stdout.write("\n".join(summary(rows)) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
