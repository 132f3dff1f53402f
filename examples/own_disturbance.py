"""A disturbance of your own: gusts of side wind, drawn from a seed
================================================================

::

    python examples/own_disturbance.py
    PYTHONPATH=examples steer-by-wire plant --set disturbance.model=own_disturbance:GUSTS
"""

from collections.abc import Iterator
from pathlib import Path
from random import Random

from matplotlib.figure import Figure
from pydantic import Field

from steer_by_wire import DisturbanceModel, DisturbanceStep, Run, Settings, simulate


class Wind(Settings):  # [disturbance.own] of a settings file
    force_n: float = Field(400.0, ge=0.0, le=1e5)
    """Standard deviation of the side force."""
    correlation_time_s: float = Field(1.0, gt=0.0, le=100.0)
    until_s: float = Field(60.0, gt=0.0, le=400.0)
    seed: int = 1


def gusts(own: Wind) -> Iterator[DisturbanceStep]:
    """Yield the force every 50 ms: a first-order autoregressive process."""
    rng, step_s, force_n = Random(own.seed), 0.05, 0.0
    decay = 1.0 - step_s / (own.correlation_time_s + step_s)
    spread_n = own.force_n * (1.0 - decay**2) ** 0.5
    for step in range(int(own.until_s / step_s)):
        force_n = decay * force_n + rng.gauss(0.0, spread_n)
        yield DisturbanceStep(at_s=step * step_s, side_force_n=force_n)


GUSTS = DisturbanceModel(gusts, settings=Wind)


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    wind = {"plant.disturbance.model": GUSTS, "plant.path.kind": "straight"}
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
