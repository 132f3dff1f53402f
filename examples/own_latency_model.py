"""A latency model of your own: two routes, one of them slow
=========================================================

A share of the frames takes the slow route.

::

    python examples/own_latency_model.py
    PYTHONPATH=examples steer-by-wire plant \\
        --set latency.downlink.model=own_latency_model:TWO_ROUTES
"""

from pathlib import Path

from matplotlib.figure import Figure
from pydantic import Field

from steer_by_wire import LatencyModel, Run, Settings, simulate


class Routes(Settings):  # [latency.downlink.own] of a settings file
    slow_share: float = Field(0.3, ge=0.0, le=1.0)
    slow_s: float = Field(0.15, ge=0.0, le=5.0)


def two_routes(u: float, mean_s: float, spread_s: float, own: Routes) -> float:
    """Return the latency that a share u of all frames stays below; each route is uniform."""
    fast_share = 1.0 - own.slow_share
    if u < fast_share:
        return mean_s + spread_s * u / fast_share
    return mean_s + own.slow_s + spread_s * (u - fast_share) / own.slow_share


TWO_ROUTES = LatencyModel(two_routes, settings=Routes)


def main(folder: Path = Path("out/examples")) -> list[Run]:
    figure = Figure(figsize=(9.0, 4.0), layout="constrained", dpi=110)
    error, latency = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
    runs = []
    for order in ("newest_wins", "in_order"):
        network = {"model": TWO_ROUTES, "mean_s": 0.02, "spread_s": 0.01, "order": order}
        run = simulate(duration_s=30.0, overrides={"plant.latency.downlink": network})
        label = f"{order}, RMS {1e3 * run.settled_rms_m:.1f} mm"
        error.plot(run.plant.time_s, 1e3 * run.plant.cg_deviation_m, label=label)
        latency_ms = 1e3 * run.plant.downlink_latency_s
        latency.hist(latency_ms, bins=range(0, 200, 10), histtype="step", label=order)
        runs.append(run)
    error.set(xlabel="time [s]", ylabel="car off the path [mm]")
    latency.set(xlabel="latency of the command in effect [ms]", ylabel="samples")
    error.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_latency_model.png")
    return runs


if __name__ == "__main__":
    main()
