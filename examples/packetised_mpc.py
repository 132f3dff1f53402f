"""Packetised MPC: a quadratic program with limits, its whole solution sent as a plan
===================================================================================

State, prediction and cost are those of the law ``packet``. Instead of feedback, the values of the
plan minimise, until 1.5 s after the plan and for the path as far as it is known,

::

    sum of (k y)² + (u - u_ss)²     u_ss holds the vehicle on the path at that sample

with angle and rate limited: least distance programming, Lawson and Hanson 1974. Compared with
``packet`` on a path known ahead, with a wheel that turns at 0.03 rad/s at most:

::

    python examples/packetised_mpc.py
"""

from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import nnls

from steer_by_wire import ControllerSettings, LawInput, LawOutput, Run, law_styles, simulate
from steer_by_wire.law_parts import (
    LAWS,
    NO_HISTORY,
    NO_LOOP_DELAY,
    EstimatorState,
    History,
    LoopDelay,
    Schedule,
    VehicleGains,
    estimate_to,
    estimator_at_rest,
    measured_gains,
    predict,
    steer_for,
    step_on_path,
)

PACKET = LAWS["packet"]
Array = NDArray[np.float64]
Cost = tuple[VehicleGains, float, int]  # model, k, samples between two values
REST = estimator_at_rest(0.0)
TAIL = 150  # samples after the plan, with the predictor's feedback


class State(NamedTuple):
    inside: Any  # state of packet
    acting: int


class Params(NamedTuple):
    inside: Any  # of packet
    weight_rad_m: float  # k
    angle_rad: float
    step_rad: float  # in one sample


def terms(
    cost: Cost,
    plan: Array,
    z: EstimatorState = REST,
    loop_delay: LoopDelay = NO_LOOP_DELAY,
    history: History = NO_HISTORY,
) -> Array:
    """Return what the cost squares, for a plan from the state z on."""
    g, weight_rad_m, spacing = cost
    steady = np.array(  # columns: side slip, yaw rate, heading error, steer
        [
            [g.beta_beta - 1.0, g.beta_r, 0.0, g.beta_u],
            [g.r_beta, g.r_r - 1.0, 0.0, g.r_u],
            [g.psi_beta, g.psi_r, 0.0, g.psi_u],
            [g.y_beta, g.y_r, g.y_psi, g.y_u],
        ]
    )
    per_curvature = np.linalg.solve(steady, [0.0, 0.0, -g.psi_rho, -g.y_rho])[3]
    ends, found = (len(plan) - 1) * spacing, []
    planned = np.interp(np.arange(ends + 1), np.arange(0, ends + 1, spacing), plan)
    for k in range(ends + TAIL):
        u = float(planned[k]) if k <= ends else steer_for(g, z, inf)
        u_ss = per_curvature * z.curvature_1_m - z.offset_rad
        found += [weight_rad_m * z.lateral_error_m, u - u_ss]
        z = step_on_path(g, loop_delay, history, z, u)
    return np.array(found)


@lru_cache(256)
def factors(cost: Cost, count: int) -> tuple[Array, Array, Array, Array]:
    """Return Q and R of the terms by the plan's values, Qᵀ of those by the state, R⁻¹ by limits."""
    q, r = np.linalg.qr(np.array([terms(cost, one) for one in np.eye(count)]).T)
    states = [EstimatorState(0, *one) for one in np.eye(len(REST) - 1).tolist()]
    by_state = q.T @ np.array([terms(cost, np.zeros(count), z) for z in states]).T
    limited = np.vstack((np.eye(count), np.eye(count) - np.eye(count, k=-1)))
    return q, r, by_state, limited @ np.linalg.inv(r)


def planned(p: Params, x: Any, observed: LawInput) -> int:
    """Replace the values that ``packet`` plans, from the one that acts first on."""
    acting = PACKET.plan(p.inside, x, observed) if PACKET.plan else -1
    if acting < 0:
        return acting
    loop_delay, history, of = observed.loop_delay, observed.history, p.inside.predictor
    row = history.plans[loop_delay.tick & history.plan_mask]
    spacing, acts, count = int(row[1]), int(row[0] + acting * row[1]), len(row) - 2 - acting
    g = measured_gains(of.measured, x.measured)
    z = estimate_to(of.loop_delay, g, x.estimate, loop_delay, history, loop_delay.error_sample)
    z = predict(of.loop_delay, g, z, loop_delay, history, float(acts - z.sample))
    cost = g, p.weight_rad_m, spacing
    q, r, by_state, limited = factors(cost, count)
    # |R values + at_zero| is to be least, with the values and the steps between them limited.
    at_zero = by_state @ z[1:]
    if loop_delay.path_end > z.sample:
        at_zero = q.T @ terms(cost, np.zeros(count), z, loop_delay, history)
    middle, reach = limited @ at_zero, np.repeat([p.angle_rad, p.step_rad * spacing], count)
    middle[count] += observed.sent_steer_rad
    reach[count] = p.step_rad
    a = np.vstack((limited.T, middle - reach)), np.vstack((-limited.T, -middle - reach))
    last = np.eye(count + 1)[-1]
    residual = np.hstack(a) @ nnls(np.hstack(a), last)[0] - last
    row[2 + acting :] = np.linalg.solve(r, -residual[:-1] / residual[-1] - at_zero).tolist()
    return acting


def step(p: Params, x: State, observed: LawInput) -> tuple[State, LawOutput]:
    inside, output = PACKET.step(p.inside, x.inside, observed)
    acting = planned(p, inside, observed)
    if acting >= 0:
        row = observed.history.plans[observed.loop_delay.tick & observed.history.plan_mask]
        output = output._replace(steer_rad=row[2 + acting])
    return State(inside, acting), output


def plan(_p: Params, x: State, _observed: LawInput) -> int:
    return x.acting


def at_rest(p: Params, lateral_error_m: float) -> State:
    return State(PACKET.at_rest(p.inside, lateral_error_m), -1)


def design(settings: ControllerSettings) -> Schedule:
    inside, period_s = PACKET.design(settings), settings.link.sensor_period_s
    limits = settings.limits.steer_rad_max, settings.limits.steer_rate_rad_s_max * period_s
    k = settings.predictor.steer_per_error_rad_m
    return Schedule(lambda speed_m_s: Params(inside.at(speed_m_s), k, *limits))


LAW = PACKET._replace(  # [own_law] is as [packet]
    step=step, at_rest=at_rest, design=design, after_hold=None, plan=plan, looking_back=None
)
SLOW_WHEEL = {
    "plant.path": {"kind": "single_lane_change", "start_m": 33.3, "offset_m": 3.5, "length_m": 65},
    "plant.vehicle.speed_m_s": 60 / 3.6,
    "plant.latency.downlink.mean_s": 0.25,
    "plant.path_ahead": {},
    "controller.limits.steer_rate_rad_s_max": 0.03,
    # A feedback that asks the slow wheel for more than the preset's, which noise has made gentle.
    "controller.predictor.steer_per_error_rad_m": 0.3,
    "controller.estimator.yaw_rate_noise_rad_s_sqrt_s": 0.023,
    "controller.estimator.curvature_walk_1_m_sqrt_s": 0.27,
    "controller.estimator.steering_offset_walk_rad_sqrt_s": 0.0026,
}


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    figure, runs = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110), {}
    axes = figure.subplots()
    laws = {"packet": "packet", "packetised MPC": LAW}
    for style, (label, law) in zip(law_styles(laws), laws.items(), strict=True):
        run = simulate(
            "highway_nominal", "highway_stiff_packet", law=law, duration_s=8.0, overrides=SLOW_WHEEL
        )
        axes.plot(run.plant.time_s, run.plant.cg_deviation_m, label=label, **style)
        runs[label] = run
    axes.set(xlabel="time [s]", ylabel="car off the path [m]", ylim=(-1.5, 1.5))
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "packetised_mpc.png")
    return runs


if __name__ == "__main__":
    main()
