"""The decay of a loop's slowest mode, by a computation that shares no line with the project.

SAE 2018-01-1086 (1), the laws' formulas, scipy's matrix exponential and bilinear rule, and the
eigenvalues of one common period of sensors and controller, from event to event. A loop is a mapping
with the keys of a controller's settings. Washouts are given: without one a law drifts, and no
eigenvalue decides.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import cont2discrete, tf2ss

Array = NDArray[np.float64]
Table = Mapping[str, Any]
Step = Callable[[Array, Array, Array, list[Array]], tuple[Array, Array]]
"""A tick: states, lateral error, heading error, past commands, newest first; states and command.

Each is a matrix or row whose columns belong to the states at the beginning of the period.
"""
OBSERVERS = {"pd_dob": ("dob",), "pd_cdob": ("cdob",), "pd_ddob": ("dob", "cdob")}


def filtered(numerator: Any, denominator: Any, period_s: float, method: str) -> list[Array]:
    """Return A, B, C and D of a filter."""
    return list(cont2discrete(tf2ss(numerator, denominator), period_s, method)[:4])


def filters_of(s: Table, period_s: float) -> dict[str, list[Array]]:
    """Return the filters of a law: pd, of each observer q and y = q over the model, ahead."""
    m, v = s["nominal_model"], s["nominal_model"]["speed_m_s"]
    a, b = vehicle_matrices(m)
    yaw, ahead_m = a[1, 0] * b[0] - a[0, 0] * b[1], m["preview_distance_m"]
    turned = v * (b[1] + a[0, 1] * b[1] - a[1, 1] * b[0])
    zeros, poles = [v * b[0] + ahead_m * b[1], turned + ahead_m * yaw, v * yaw], np.poly(a[:2, :2])
    k_p, k_d = (s["pd"][f"{key}"] for key in ("proportional_gain_rad_m", "derivative_gain_rad_s_m"))
    n = s["pd"].get("derivative_filter_rad_s")
    if n is None:
        matrices = [[[0.0]], [[1.0]], [[-k_d / period_s]], [[k_p + k_d / period_s]]]
        filters = {"pd": [np.array(each) for each in matrices]}
    else:
        filters = {"pd": filtered([k_p / n + k_d, k_p], [1.0 / n, 1.0], period_s, "bilinear")}
    for name in OBSERVERS.get(s["law"], ()):
        w = s[name]["q_cutoff_rad_s"]
        top, bottom = [w**2], np.poly([-w] * 2)
        if s[name].get("q_kind") == "type_2":
            top, bottom = [3.0 * w**2, w**3], np.poly([-w] * 3)
        filters[f"{name} q"] = filtered(top, bottom, period_s, "zoh")
        top, bottom = np.polymul(np.polymul(top, poles), [1.0, 0.0, 0.0]), np.polymul(bottom, zeros)
        filters[f"{name} y"] = filtered(top, bottom, period_s, "bilinear")
    for table in (s[name] for name in ("cdob", "smith") if name in s):
        bottom = np.polymul(poles, np.poly([-table["washout_rad_s"]] * 2))
        filters["ahead"] = filtered(zeros, bottom, period_s, "bilinear")
    return filters


def law_of(s: Table, period_s: float) -> tuple[int, Step]:
    """Return the number of states of a law, and its step."""
    filters = filters_of(s, period_s)
    places = np.cumsum([0, *(len(each[0]) for each in filters.values())]).tolist()
    at = {name: slice(*places[i : i + 2]) for i, name in enumerate(filters)}
    last, integral = places[-1], places[-1] + 1

    def step(x: Array, y: Array, psi: Array, sent: list[Array]) -> tuple[Array, Array]:
        new = np.zeros_like(x)

        def through(name: str, value: Array) -> Array:
            a, b, c, d = filters[name]
            new[at[name]] = a @ x[at[name]] + np.outer(b[:, 0], value)
            # A filter of the last command has acted by now.
            seen = (new if name.endswith("q") else x)[at[name]]
            return np.asarray((c @ seen)[0] + d[0, 0] * value)

        u, acting, fed_back = np.zeros_like(y), sent[0], y
        if "dob q" in filters:
            new[last] = through("dob y", y) - through("dob q", sent[0])
            u, acting = -new[last], acting + x[last]
        if "cdob q" in filters:
            fed_back = y + through("ahead", through("cdob q", acting) - through("cdob y", y))
        if s["law"] == "smith":
            back = max(0.0, s["smith"]["delay_s"] / period_s - 0.5)
            whole, part = int(back), back - int(back)
            late = (1.0 - part) * sent[whole] + part * sent[whole + 1]
            fed_back = y + through("ahead", sent[0] - late)
        u = u - through("pd", fed_back)
        if s["law"] == "pid":
            new[integral] = x[integral] - s["pid"]["integral_gain_rad_m_s"] * period_s * y
            u = u + new[integral] - s["pid"].get("heading_gain_rad_rad", 0.0) * psi
        return new, u

    return places[-1] + 2, step


def vehicle_matrices(m: Table) -> tuple[Array, Array]:
    """Return A and the wheel's column of (1): sideslip, yaw rate, heading and lateral error."""
    cf, cr = m["front_cornering_stiffness_n_rad"], m["rear_cornering_stiffness_n_rad"]
    lf, lr = m["front_axle_distance_m"], m["rear_axle_distance_m"]
    mass, j, v = m["virtual_mass_kg"], m["yaw_inertia_kg_m2"], m["speed_m_s"]
    turning, a = lr * cr - lf * cf, np.zeros((4, 4))
    a[0, :2] = -(cf + cr) / (mass * v), turning / (mass * v**2) - 1.0
    a[1, :2] = turning / j, -(cf * lf**2 + cr * lr**2) / (j * v)
    a[2, 1] = 1.0
    a[3, :3] = v, m["preview_distance_m"], v
    return a, np.array([cf / (mass * v), cf * lf / j, 0.0, 0.0])


def decay_1_s(
    s: Table, driven: Table, delay_ns: int, lag_s: float = 0.0, uplink_ns: int = 0
) -> float:
    """Return the decay of the slowest mode of a law around the vehicle that is driven [1/s].

    ``lag_s``  of the wheel behind the command; ``uplink_ns``  latency of every measurement
    """
    tick_ns, sample_ns = round(1e9 / s["rate_hz"]), round(1e6 * s["link"]["sensor_period_ms"])
    end_ns = math.lcm(tick_ns, sample_ns)
    states, step = law_of(s, tick_ns * 1e-9)
    commands = delay_ns // tick_ns + 2
    if s["law"] == "smith":
        commands = max(commands, int(s["smith"]["delay_s"] * 1e9 / tick_ns) + 2)
    samples = (uplink_ns + tick_ns) // sample_ns + 2
    start = np.eye(5 + states + commands + 2 * samples)
    law, sent, seen = start[5 : 5 + states], dict[int, Array](), dict[int, Array]()
    for i in range(commands):
        sent[-1 - i] = start[5 + states + i]
    for i in range(samples):
        seen[-1 - i] = start[5 + states + commands + 2 * i :][:2]
    plant = np.vstack([start[:5], sent[-max(1, -(-delay_ns // tick_ns))]])
    slope, moved, now_ns = slope_of(driven, lag_s), dict[int, Array](), 0
    acting = {k * tick_ns + delay_ns for k in range(-commands, end_ns // tick_ns)}
    instants = acting | {*range(0, end_ns, tick_ns), *range(0, end_ns, sample_ns), end_ns}
    for t in sorted(each for each in instants if 0 <= each <= end_ns):
        if t - now_ns not in moved:
            moved[t - now_ns] = expm(slope * (t - now_ns) * 1e-9)
        plant, now_ns = moved[t - now_ns] @ plant, t
        if t == end_ns:
            break
        if t % sample_ns == 0:
            seen[t // sample_ns] = plant[[3, 2]]
        if t % tick_ns == 0:
            y, psi = seen[(t - uplink_ns) // sample_ns]
            newest = t // tick_ns
            past = [sent[newest - 1 - i] for i in range(commands)]
            law, sent[newest] = step(law, y, psi, past)
        if t in acting:
            plant[5] = sent[(t - delay_ns) // tick_ns]
    kept = [
        one[k] for one, n in ((sent, commands), (seen, samples)) for k in sorted(one)[-n:][::-1]
    ]
    poles = np.linalg.eigvals(np.vstack([plant[:5], law, *kept]))
    return float(-np.log(np.abs(poles).max()) / (end_ns * 1e-9))


def slope_of(driven: Table, lag_s: float) -> Array:
    """Return the slopes of vehicle, wheel and acting command, which without lag is the wheel."""
    a, b = vehicle_matrices(driven)
    slope = np.zeros((6, 6))
    slope[:4, :4], slope[:4, 4 if lag_s else 5] = a, b
    slope[4, 4:] = np.array([-1.0, 1.0]) / (lag_s or 0.01)
    return slope
