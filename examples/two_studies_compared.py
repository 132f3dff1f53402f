"""Two studies compared: what does a network in order cost?
========================================================

Both studies have the same laws, latencies and seeds. In one a newer command overtakes a late one,
in the other it waits behind it.

::

    python examples/two_studies_compared.py
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from steer_by_wire import law_styles, run_study

STUDY = """
name = "ORDER"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_pd_ddob"]
[base.plant]
duration_s = 30.0
latency.downlink = { model = "gamma", order = "ORDER" }
[[factors]]
name = "mean_s"
key = "plant.latency.downlink.mean_s"
values = [0.04, 0.1, 0.16, 0.22, 0.28]
[[factors]]
key = "plant.latency.downlink.spread_fraction"
values = [0.5]
[sampling]
replicates = 3
seed = 1
"""
ORDERS = {"newest_wins": "-", "in_order": "--"}


def main(folder: Path = Path("out/examples")) -> Mapping[str, Mapping[str, Any]]:
    folder.mkdir(parents=True, exist_ok=True)
    tables = {}
    figure = Figure(figsize=(8.0, 4.5), layout="constrained", dpi=110)
    axes = figure.subplots()
    for order, style in ORDERS.items():
        file = folder / f"{order}.toml"
        file.write_text(STUDY.replace("ORDER", order))
        tables[order] = table = run_study(file)
        laws = np.unique(table["controller"])
        looks = law_styles(law.removeprefix("practical_") for law in laws)
        for law, look in zip(laws, looks, strict=True):
            is_law = table["controller"] == law
            means_s = np.unique(table["mean_s"])
            rms_mm = [
                1e3 * np.median(table["settled_rms_m"][is_law & (table["mean_s"] == mean)])
                for mean in means_s
            ]
            axes.plot(
                1e3 * means_s,
                rms_mm,
                style,
                color=look["color"],
                marker="o",
                label=f"{law}, {order}",
            )
    axes.set(xlabel="mean latency of the commands [ms]", ylabel="RMS of the car, median [mm]")
    axes.set(yscale="log", title="Jitter of half the mean: frames overtaken, or kept in order")
    axes.legend()
    figure.savefig(folder / "two_studies_compared.png")
    return tables


if __name__ == "__main__":
    main()
