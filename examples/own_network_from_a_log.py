"""A network of your own, from the log of a ping
=============================================

The log is from ``ping -D -i 0.25 HOST > ping.log``, in the folder where this runs. Without one an
artificial log is taken: a vehicle changes to a slower radio cell after 27 s.

Half of each round trip delays the commands, the other half the measurements.

::

    python examples/own_network_from_a_log.py
"""

import re
from pathlib import Path
from random import Random

from matplotlib.figure import Figure

from steer_by_wire import Run, law_styles, simulate

LAWS = ("practical_pd", "practical_pd_ddob", "practical_predictor")


def artificial_log() -> str:
    rng, lines = Random(1), []
    for number in range(240):
        ms = (45.0 if number < 108 else 125.0) + rng.expovariate(0.06)
        arrival_s = 1.7e9 + 0.25 * number + 1e-3 * ms
        lines.append(
            f"[{arrival_s:.6f}] 64 bytes from 192.0.2.1: icmp_seq={number} time={ms:.1f} ms"
        )
    return "\n".join(lines)


def write_trace(log: str, file: Path) -> None:
    """Write time of sending and half the round trip of every answer, as the plant reads it."""
    answers = re.findall(r"^\[([\d.]+)\] .* time=([\d.]+) ms", log, re.MULTILINE)
    sent_s = [float(arrival) - 1e-3 * float(ms) for arrival, ms in answers]
    rows = [
        f"{sent - sent_s[0]:.3f},{0.5e-3 * float(ms):.5f}"
        for sent, (_, ms) in zip(sent_s, answers, strict=True)
    ]
    file.write_text("\n".join(["time_s,latency_s", *rows]) + "\n")


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    folder.mkdir(parents=True, exist_ok=True)
    trace = folder / "ping.csv"
    log = Path("ping.log")
    write_trace(log.read_text() if log.exists() else artificial_log(), trace)
    network = {f"plant.latency.{way}.trace_file": trace for way in ("downlink", "uplink")}
    runs = {
        law: simulate(controller=law, duration_s=60.0, overrides=network, engine="compiled")
        for law in LAWS
    }
    figure = Figure(figsize=(9.0, 6.0), layout="constrained", dpi=110)
    latency, error = figure.subplots(2, 1, sharex=True)
    styles = law_styles(law.removeprefix("practical_") for law in LAWS)
    for style, (law, run) in zip(styles, runs.items(), strict=True):
        label = f"{law}, RMS {1e3 * run.settled_rms_m:.1f} mm"
        error.plot(run.plant.time_s, 1e3 * run.plant.cg_deviation_m, label=label, **style)
    plant = runs[LAWS[0]].plant
    latency.plot(plant.time_s, 1e3 * plant.downlink_latency_s, ".", ms=2.0, label="commands")
    latency.set(ylabel="latency [ms]", title="Latency from a ping log")
    error.set(xlabel="time [s]", ylabel="car off the path [mm]")
    error.legend()
    figure.savefig(folder / "own_network_from_a_log.png")
    return runs


if __name__ == "__main__":
    main()
