"""How late may the torque come? A hand wheel on a late spring
============================================================

A wheel with nothing but inertia, damping and a spring that answers over the bus shakes from a round
trip on that a formula gives. Runs on both sides of it show how far it swings in the last 5 of 60 s,
as a multiple of an early swing: less than 1 dies down, more than 1 grows.

::

    python examples/felt_delay.py
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from steer_by_wire import feedback_stability, simulate

DAMPINGS_N_M_S = (0.2, 0.4)
SHARES = (0.96, 0.98, 1.0, 1.02)


def growth(wheel: dict[str, float], stiffness_n_m: float, round_trip_s: float) -> float:
    """Return the wheel's last swing over an early one, after a small kick, hands off."""
    given = {
        "plant.path.kind": "straight",
        "plant.sensor_period_ms": 1.0,
        "plant.actuator.lag_s": 0.0,
        "plant.latency.uplink.mean_s": round_trip_s,
        "controller.hand_wheel.steered_by": "driver",
        "hand_wheel.cycle_ms": 1.0,
        "hand_wheel.wheel": {**wheel, "friction_n_m": 0.0, "motor_lag_s": 1e-4},
        "hand_wheel.feedback": {"law": "spring", "torque_gradient_n_m": stiffness_n_m},
        "hand_wheel.driver.kicks": [{"at_s": 1.0, "torque_n_m": 0.1}],
    }
    run = simulate(
        "highway_nominal", "highway_pd", hand_wheel="hands_off", duration_s=60.0,
        overrides=given, engine="compiled",
    )  # fmt: skip
    angle_rad: Any = run.hand_wheel.angle_rad if run.hand_wheel else None
    return float(np.ptp(angle_rad[-5000:]) / np.ptp(angle_rad[5000:10000]))


def main(folder: Path = Path("out/examples")) -> dict[str, list[float]]:
    axes = (figure := Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)).subplots()
    grown = {}
    for damping_n_m_s in DAMPINGS_N_M_S:
        wheel = {"inertia_kg_m2": 0.04, "damping_n_m_s": damping_n_m_s}
        stable_s = feedback_stability(**wheel, stiffness_n_m=2.0).stable_delay_s
        name = f"{damping_n_m_s} N m s/rad, {1e3 * stable_s:.0f} ms"
        grown[name] = [growth(wheel, 2.0, share * stable_s) for share in SHARES]
        axes.semilogy([100.0 * share for share in SHARES], grown[name], "o-", label=name)
    axes.axhline(1.0, color="0.5", linewidth=1.0)
    axes.set(xlabel="round trip [% of the predicted]", ylabel="last swing over an early one")
    axes.set_title("A hand wheel on a late spring of 2 N m/rad, hands off")
    axes.legend(title="damping, predicted")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "felt_delay.png")
    return grown


if __name__ == "__main__":
    print("of the predicted         ", *(f"{share:6.2f}" for share in SHARES))
    for damping, grown in main().items():
        print(f"{damping:25}", *(f"{it:6.2f}" for it in grown))
