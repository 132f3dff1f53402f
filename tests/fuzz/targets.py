"""The targets by name: what ``python -m tests.fuzz`` and the suite run.

A target takes any bytes, returns nothing, and raises on a broken promise: BrokenPromiseError for
what it has checked itself, any other exception for one that has escaped.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tests.fuzz.bus_targets import fuzz_broker, fuzz_bus_client
from tests.fuzz.campaign_targets import fuzz_results, fuzz_specification
from tests.fuzz.command_lines import fuzz_command_line
from tests.fuzz.log_targets import fuzz_log
from tests.fuzz.node_targets import fuzz_authentication, fuzz_controller, fuzz_plant
from tests.fuzz.settings_targets import fuzz_settings, fuzz_trace, fuzz_waypoints

_FUZZERS: tuple[Callable[[bytes], None], ...] = (
    *(fuzz_authentication, fuzz_broker, fuzz_bus_client, fuzz_command_line),
    *(fuzz_controller, fuzz_log, fuzz_plant, fuzz_results),
    *(fuzz_settings, fuzz_specification, fuzz_trace, fuzz_waypoints),
)
TARGETS: Mapping[str, Callable[[bytes], None]] = MappingProxyType(
    {fuzzer.__name__.removeprefix("fuzz_"): fuzzer for fuzzer in _FUZZERS}
)
