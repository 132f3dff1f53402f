"""The targets by name: what ``python -m tools.fuzz`` and the suite run.

A target takes any bytes, returns nothing, and raises whatever is not promised: BrokenPromiseError
for what it has noticed itself, any other exception for what has escaped.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tools.fuzz.node_targets import fuzz_controller, fuzz_plant
from tools.fuzz.settings_targets import fuzz_settings, fuzz_trace, fuzz_waypoints

TARGETS: Mapping[str, Callable[[bytes], None]] = MappingProxyType(
    {
        "controller": fuzz_controller,
        "plant": fuzz_plant,
        "settings": fuzz_settings,
        "trace": fuzz_trace,
        "waypoints": fuzz_waypoints,
    }
)
