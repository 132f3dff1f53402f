"""Networked predictive control, as published
===========================================

After Liu, Xia, Chen, Rees and Hu, IEEE Transactions on Industrial Electronics 54 (2), 2007. An
observer of the single-track model follows the delayed output. The model runs on through the
commands in transit, then with its own feedback. The whole sequence is sent, and the plant takes the
value that is due. Neither the path nor a disturbance is in the model:

::

    x[k+1] = F x[k] + G u[k],   u[k] = the commands in transit, then -K x[k],   x = (β, r, Δψ, y)

Compared with ``predictor``, with the tables of ``highway_stiff_packet``, behind 250 ms:

::

    python examples/networked_prediction.py
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from steer_by_wire import ControllerSettings, Law, LawInput, LawOutput, Run, law_styles, simulate
from steer_by_wire.law_parts import (
    PLAN_VALUES,
    LoopDelayParams,
    Schedule,
    command_from,
    noise_covariances,
    plan_times,
    sampled_vehicles,
    vehicle_of,
)

Array = NDArray[np.float64]
H = np.eye(4)[[3, 2]]  # y and Δψ are measured


class Params(NamedTuple):
    loop_delay: LoopDelayParams
    reserve_samples: int
    f: Array
    g: Array
    k: Array
    observer: Array


class State(NamedTuple):
    sample: int
    x: Array
    acting: int
    row: list[float]  # the plan: first sample, spacing, values


def design(settings: ControllerSettings) -> Schedule:
    noise, period_s = settings.estimator, settings.link.sensor_period_s
    q, r = noise_covariances(noise, period_s)
    q = q[:4, :4] + np.diag([0.0, 0.0, 1e-2, 0.0]) * period_s  # a bend acts like this noise
    weight = np.diag([0.0, 0.0, 0.0, settings.predictor.steer_per_error_rad_m**2])
    loop_delay, reserve_samples = (
        settings.loop_delay,
        round(settings.packet.reserve_s / period_s),
    )

    @cache
    def at(speed_m_s: float) -> Params:
        speeds_m_s = [max(speed_m_s, noise.speed_m_s_min)]
        sampled = sampled_vehicles(noise, vehicle_of(settings), speeds_m_s, period_s)
        f, g = sampled.f[0, :4, :4], sampled.g[0, :4]
        p, s = solve_discrete_are(f, g[:, None], weight, 1.0), solve_discrete_are(f.T, H.T, q, r)
        observer = s @ H.T @ np.linalg.inv(H @ s @ H.T + r)
        return Params(loop_delay, reserve_samples, f, g, g @ p @ f / (1.0 + g @ p @ g), observer)

    return Schedule(at)


def step(p: Params, before: State, observed: LawInput) -> tuple[State, LawOutput]:
    loop_delay, history, sample, x = observed.loop_delay, observed.history, before.sample, before.x
    while sample < loop_delay.error_sample:
        x = p.f @ x + p.g * command_from(p.loop_delay, loop_delay, history, sample)
        sample += 1
        at = sample & history.sample_mask
        if history.has_error[at]:
            y = history.lateral_error_m[at], history.heading_error_rad[at]
            x = x + p.observer @ (y - H @ x)
    first, spacing, acting = plan_times(p.loop_delay, p.reserve_samples, loop_delay, sample)
    acts, z, values = first + acting * spacing, x, [0.0] * max(PLAN_VALUES, acting + 1)
    for k in range(sample, first + len(values) * spacing):
        u = command_from(p.loop_delay, loop_delay, history, k) if k < acts else -float(p.k @ z)
        if k == sample or (k - first) % spacing == 0:
            values[(k - first) // spacing] = u
        z = p.f @ z + p.g * u
    acting_rad, row = values[acting], [float(first), float(spacing), *values[:PLAN_VALUES]]
    return State(sample, x, acting, row), LawOutput(acting_rad, 0.0, 0.0, float(x[3]))


def plan(_p: Params, x: State, observed: LawInput) -> int:
    if x.acting >= PLAN_VALUES or not observed.loop_delay.is_measured:
        return -1
    observed.history.plans[observed.loop_delay.tick & observed.history.plan_mask][:] = x.row
    return x.acting


def at_rest(_p: Params, lateral_error_m: float) -> State:
    return State(-1, np.array([0.0, 0.0, 0.0, lateral_error_m]), -1, [])


NEEDS = ("packet", "predictor", "nominal_model")
LAW = Law(step, at_rest, design, needs=NEEDS, needs_vehicle=True, looks_back=True, plan=plan)


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    case = {
        "plant.path": {
            "kind": "single_lane_change",
            "start_m": 33.3,
            "offset_m": 3.5,
            "length_m": 90,
        },
        "plant.vehicle.speed_m_s": 60 / 3.6,
        "plant.latency.downlink.mean_s": 0.25,
    }
    figure, runs = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110), {}
    axes = figure.subplots()
    laws: dict[str, str | Law] = {"predictor": "predictor", "as published": LAW}
    for style, (label, law) in zip(law_styles(laws), laws.items(), strict=True):
        run = simulate(
            "highway_nominal", "highway_stiff_packet", law=law, duration_s=8.0, overrides=case
        )
        axes.plot(run.plant.time_s, run.plant.cg_deviation_m, label=label, **style)
        runs[label] = run
    axes.set(xlabel="time [s]", ylabel="car off the path [m]")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "networked_prediction.png")
    return runs


if __name__ == "__main__":
    main()
