"""Any bytes into all that reads bytes: each target says what it promises.

Hypothesis prefers short inputs, so noise as long as a run of a second comes with it.
"""

from collections.abc import Callable
from random import Random

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.fuzz.bus_targets import fuzz_broker, fuzz_bus_client
from tests.fuzz.command_lines import fuzz_command_line
from tests.fuzz.log_targets import fuzz_log
from tests.fuzz.node_targets import fuzz_controller, fuzz_hand_wheel, fuzz_plant
from tests.fuzz.settings_targets import fuzz_settings, fuzz_trace, fuzz_waypoints
from tests.support.suite.combinations import sampled

EXAMPLES = {
    fuzz_broker: 25,
    fuzz_bus_client: 20,
    fuzz_command_line: 20,
    fuzz_controller: 20,
    fuzz_log: 20,
    fuzz_plant: 15,
    fuzz_hand_wheel: 15,
    fuzz_settings: 20,
    fuzz_trace: 10,
    fuzz_waypoints: 6,
}
"""How many of each, so that all together take seconds."""
EACH = sampled(1, 20)
LENGTHS = (40, 400, 1500)
NEEDS_POSIX = {fuzz_broker, fuzz_bus_client, fuzz_command_line}


@pytest.mark.parametrize("target", EXAMPLES, ids=lambda target: target.__name__)
def test_no_bytes_break_a_promise(target: Callable[[bytes], None]) -> None:
    if target in NEEDS_POSIX:
        pytest.importorskip("fcntl", reason="Unix sockets and devices are for Unix")

    @settings(
        max_examples=EACH * EXAMPLES[target],
        derandomize=EACH == 1,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=tuple(HealthCheck),
    )
    @given(st.binary(max_size=300))
    def short(data: bytes) -> None:
        target(data)

    short()
    random = Random(target.__name__)
    for index in range(EACH * EXAMPLES[target] // 2):
        target(random.randbytes(LENGTHS[index % len(LENGTHS)]))
