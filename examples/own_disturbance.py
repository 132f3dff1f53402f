"""A disturbance of your own: gusts of side wind, drawn from a seed
================================================================

::

    python examples/own_disturbance.py
"""

from pathlib import Path
from random import Random

from matplotlib.figure import Figure

from steer_by_wire import Run, simulate


def gusts(force_n: float, correlation_time_s: float, until_s: float) -> list[dict[str, float]]:
    """Return the force every 50 ms: a first-order autoregressive process of this deviation."""
    rng, step_s, gust_n, steps = Random(1), 0.05, 0.0, []
    decay = 1.0 - step_s / (correlation_time_s + step_s)
    spread_n = force_n * (1.0 - decay**2) ** 0.5
    for step in range(int(until_s / step_s)):
        gust_n = decay * gust_n + rng.gauss(0.0, spread_n)
        steps.append({"at_s": step * step_s, "side_force_n": gust_n})
    return steps


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    steps = gusts(400.0, 1.0, 60.0)
    wind = {"plant.disturbance.steps": steps, "plant.path.kind": "straight"}
    figure = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    runs = {}
    for law in ("practical_pd", "practical_pd_ddob"):
        run = simulate(controller=law, duration_s=30.0, overrides=wind, engine="compiled")
        runs[law] = run
        label = f"{law}, RMS {1e3 * run.settled_rms_m:.2f} mm"
        axes.plot(run.plant.time_s, 1e3 * run.plant.cg_deviation_m, label=label)
    axes.set(xlabel="time [s]", ylabel="car off the path [mm]", title="Gusts of side wind")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_disturbance.png")
    return runs


if __name__ == "__main__":
    main()
