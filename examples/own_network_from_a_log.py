"""A network of your own, from the log of a ping
=============================================

The log is from ``ping -D -i 0.25 HOST > ping.log``.

Half of each round trip delays the commands, the other half the measurements. (The log beside this
file is artificial: a vehicle changes to a slower radio cell after 27 s.)

::

    python examples/own_network_from_a_log.py
"""

import re
from pathlib import Path

from matplotlib.figure import Figure

from steer_by_wire import Run, simulate

LAWS = ("practical_pd", "practical_pd_ddob", "practical_predictor")


def write_trace(log: Path, file: Path) -> None:
    """Write time of sending and half the round trip of every answer, as the plant reads it."""
    answers = re.findall(r"^\[([\d.]+)\] .* time=([\d.]+) ms", log.read_text(), re.MULTILINE)
    sent_s = [float(arrival) - 1e-3 * float(ms) for arrival, ms in answers]
    rows = [
        f"{sent - sent_s[0]:.3f},{0.5e-3 * float(ms):.5f}"
        for sent, (_, ms) in zip(sent_s, answers, strict=True)
    ]
    file.write_text("\n".join(["time_s,latency_s", *rows]) + "\n")


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    folder.mkdir(parents=True, exist_ok=True)
    trace = folder / "ping.csv"
    log = Path(main.__code__.co_filename).with_name("ping.log")  # also in a notebook: no __file__
    write_trace(log, trace)
    network = {f"plant.latency.{way}.trace_file": trace for way in ("downlink", "uplink")}
    runs = {law: simulate(controller=law, duration_s=60.0, overrides=network) for law in LAWS}
    figure = Figure(figsize=(9.0, 6.0), layout="constrained", dpi=110)
    latency, error = figure.subplots(2, 1, sharex=True)
    for law, run in runs.items():
        label = f"{law}, RMS {1e3 * run.lateral_error_rms_m:.1f} mm"
        error.plot(run.plant.time_s, 1e3 * run.plant.lateral_error_m, label=label)
    plant = runs[LAWS[0]].plant
    latency.plot(plant.time_s, 1e3 * plant.downlink_latency_s, ".", ms=2.0, label="commands")
    latency.set(ylabel="latency [ms]", title="Latency from a ping log")
    error.set(xlabel="time [s]", ylabel="lateral error [mm]")
    error.legend()
    figure.savefig(folder / "own_network_from_a_log.png")
    return runs


if __name__ == "__main__":
    main()
