"""A car of your own, from the log of a drive
==========================================

The log is ``drive.csv``, in the folder where this runs, with columns ``time_s``,
``wheel_angle_rad``, ``speed_m_s`` and ``yaw_rate_rad_s``. Without one a large sedan changes lanes.

::

    python examples/own_car_from_a_log.py
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from steer_by_wire import simulate

COLUMNS = ("time_s", "wheel_angle_rad", "speed_m_s", "yaw_rate_rad_s")


def artificial_drive(file: Path) -> None:
    path = {"plant.path": {"kind": "double_lane_change", "start_m": 10.0, "offset_m": 3.5}}
    run = simulate("large_sedan", "highway_pd", duration_s=14.0, overrides=path)
    speed_m_s = np.full(len(run.plant.time_s), 16.7)
    columns = run.plant.time_s, run.plant.wheel_angle_rad, speed_m_s, run.plant.yaw_rate_rad_s
    header = ",".join(COLUMNS)
    np.savetxt(file, np.column_stack(columns), "%.6f", ",", header=header, comments="")


def main(folder: Path = Path("out/examples")) -> dict[str, list[float]]:
    folder.mkdir(parents=True, exist_ok=True)
    log, car = Path("drive.csv"), folder / "car"
    if not log.exists():
        log = folder / "drive.csv"
        artificial_drive(log)
    identify = [sys.executable, "-m", "steer_by_wire.tools.identify", log, "--out", car]
    subprocess.run([*map(str, identify)], check=True)
    figures = json.loads((car / "report.json").read_text())["figures"]
    delays_s = [0.0, 0.1]
    peaks_m = [
        simulate("highway_nominal", "highway_pd", vehicle=car / "vehicle.toml", latency_s=delay_s,
                 duration_s=8.0).peak_m
        for delay_s in delays_s
    ]  # fmt: skip
    figure = Figure(figsize=(9.0, 3.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    axes.plot([1e3 * delay_s for delay_s in delays_s], peaks_m, "o-")
    axes.set(xlabel="delay of the commands [ms]", ylabel="largest deviation [m]")
    figure.savefig(folder / "own_car_from_a_log.png")
    return {name: one["interval"] for name, one in figures.items()} | {"peaks_m": peaks_m}


if __name__ == "__main__":
    main()
