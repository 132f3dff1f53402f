"""The guard designed from the settings and from what the bus can carry."""

import subprocess
import sys

from steer_by_wire.dbc.messages import SteeringCommand, limits
from steer_by_wire.plant_emulator.steering.settings import SafetySettings, design_guard
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings

_FOLLOW_NS = """
from steer_by_wire.plant_emulator.steering.settings import SafetySettings, design_guard
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings

slow = ActuatorSettings(rate_limit_rad_s=0.5)
print(design_guard(SafetySettings(), VehicleSettings(), slow).limiter.follow_ns)
"""
_HALF_THE_RANGE = """
from steer_by_wire.dbc.contract import generated_layout

def halved(signal):
    if signal.name != "STEER":
        return signal
    return signal._replace(minimum=signal.minimum / 2, maximum=signal.maximum / 2)

generated_layout.LAYOUTS = tuple(
    layout._replace(signals=tuple(map(halved, layout.signals)))
    for layout in generated_layout.LAYOUTS
)
"""


def follow_s(code: str) -> float:
    """How long a wheel of 0.5 rad/s may be off its target, after ``code`` in a new interpreter."""
    run = (sys.executable, "-c", code + _FOLLOW_NS)
    return int(subprocess.run(run, check=True, capture_output=True, text=True).stdout) * 1e-9


def test_a_slow_wheel_has_time_for_the_largest_angle_of_the_dbc() -> None:
    """From end to end of the commands, and the 0.1 s of ``follow_time_ms``."""
    steer_rad_max = limits(SteeringCommand)["steer_rad"].maximum
    slow = ActuatorSettings(rate_limit_rad_s=0.5)
    follow_ns = design_guard(SafetySettings(), VehicleSettings(), slow).limiter.follow_ns
    assert round(1e-9 * follow_ns, 6) == round(0.1 + 2.0 * steer_rad_max / 0.5, 6)
    assert round(follow_s(_HALF_THE_RANGE), 6) == round(0.1 + steer_rad_max / 0.5, 6)
