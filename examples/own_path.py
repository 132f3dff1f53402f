"""A path of your own: a slalom, written as curvature over arc length
==================================================================

::

    python examples/own_path.py
    PYTHONPATH=examples steer-by-wire plant --set path.kind=own --set path.model=own_path:SLALOM
"""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from pydantic import Field

from steer_by_wire import PathModel, Run, Settings, path_of_curvature, simulate


class Slalom(Settings):  # [path.own] of a settings file
    bends: int = Field(6, ge=1, le=100)
    bend_m: float = Field(12.0, ge=1.0, le=1000.0)
    curvature_1_m: float = Field(0.05, gt=0.0, le=0.2)


def slalom(own: Slalom) -> Any:
    """Return a road that bends to the left and right in turn; straight before and after."""
    points, start_m = [(5.0, 0.0)], 5.0
    for bend in range(own.bends):
        # The first and the last bend are half as long: the road ends in its first direction.
        length_m = own.bend_m * (0.5 if bend in (0, own.bends - 1) else 1.0)
        side = 1.0 if bend % 2 == 0 else -1.0
        points.append((start_m + 0.5 * length_m, side * own.curvature_1_m))
        start_m += length_m
        points.append((start_m, 0.0))
    return path_of_curvature(points)


SLALOM = PathModel(slalom, settings=Slalom)


def main(folder: Path = Path("out/examples")) -> Run:
    path = {"kind": "own", "model": SLALOM, "own": {"bends": 7}}
    run = simulate(
        duration_s=40.0, overrides={"plant.path": path, "plant.latency.downlink.mean_s": 0.15}
    )
    track = run.track()
    figure = Figure(figsize=(9.0, 4.5), layout="constrained", dpi=110)
    above, error = figure.subplots(2, 1)
    above.plot(track.path_x_m, track.path_y_m, "k--", label="path")
    above.plot(track.x_m, track.y_m, label="preview point")
    above.set(xlabel="x [m]", ylabel="y [m]", title="The slalom from above (y drawn larger than x)")
    above.legend()
    error.plot(run.plant.time_s, 1e3 * run.plant.cg_deviation_m)
    error.set(xlabel="time [s]", ylabel="car off the path [mm]")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_path.png")
    return run


if __name__ == "__main__":
    main()
