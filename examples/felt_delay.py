"""How late may the torque come? A hand wheel with force feedback
=================================================================

::

    python examples/felt_delay.py
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from steer_by_wire import simulate

LAWS: dict[str, dict[str, Any]] = {
    "force as it arrives": {"law": "rack_force"},
    "with damping": {"law": "rack_force", "damping_n_m_s": 0.1},
    "CDOB": {"law": "cdob"},
}
ROUND_TRIPS_S = (0.02, 0.06, 0.1, 0.12, 0.14, 0.17, 0.2)


def swing_rad(round_trip_s: float, feedback: dict[str, Any]) -> float:
    """Return how far the wheel swings in the last 5 s of 25, after a kick at 1 s."""
    given = {
        "plant.path.kind": "straight",
        "plant.latency.uplink.mean_s": round_trip_s,
        "controller.hand_wheel.steered_by": "driver",
        "hand_wheel.wheel.friction_n_m": 0.0,
        **{f"hand_wheel.feedback.{key}": value for key, value in feedback.items()},
    }
    run = simulate(
        "highway_nominal", "highway_pd", hand_wheel="hands_off", duration_s=25.0,
        overrides=given, engine="compiled",
    )  # fmt: skip
    wheel: Any = run.hand_wheel
    return float(np.ptp(wheel.angle_rad[wheel.time_s > 20.0]))


def main(folder: Path = Path("out/examples")) -> dict[str, list[float]]:
    figure = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    swings = {}
    for name, feedback in LAWS.items():
        swings[name] = [swing_rad(delay_s, feedback) for delay_s in ROUND_TRIPS_S]
        axes.plot([1e3 * it for it in ROUND_TRIPS_S], swings[name], "o-", label=name)
    axes.set(xlabel="latency of the road's force [ms]", ylabel="swing of the wheel [rad]")
    axes.set_title("A hand wheel at 45 km/h, 20 s after a kick, hands off")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "felt_delay.png")
    return swings


if __name__ == "__main__":
    print("round trip [ms]     ", *(f"{1e3 * it:6.0f}" for it in ROUND_TRIPS_S))
    for law, swings in main().items():
        print(f"{law:20}", *(f"{swing:6.3f}" for swing in swings))
