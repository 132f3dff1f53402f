"""Anything into all that reads anything: each target says what it promises."""

from collections.abc import Callable
from random import Random, SystemRandom

import pytest

from tests.fuzz.bus_targets import fuzz_broker, fuzz_bus_client
from tests.fuzz.command_lines import fuzz_command_line, fuzz_damaged_file
from tests.fuzz.log_targets import fuzz_log
from tests.fuzz.node_targets import fuzz_controller, fuzz_hand_wheel, fuzz_plant
from tests.fuzz.settings_targets import fuzz_settings, fuzz_trace, fuzz_waypoints
from tests.support.suite.combinations import ALL

EXAMPLES = {
    fuzz_broker: 40,
    fuzz_bus_client: 30,
    fuzz_command_line: 30,
    fuzz_controller: 30,
    fuzz_damaged_file: 30,
    fuzz_log: 30,
    fuzz_plant: 25,
    fuzz_hand_wheel: 25,
    fuzz_settings: 60,
    fuzz_trace: 15,
    fuzz_waypoints: 3,
}
"""How many of each, so that all together take seconds: a path through points takes two."""
NEEDS_POSIX = {fuzz_broker, fuzz_bus_client, fuzz_command_line, fuzz_damaged_file}


@pytest.mark.parametrize("target", EXAMPLES, ids=lambda target: target.__name__)
def test_nothing_breaks_a_promise(target: Callable[[Random], None]) -> None:
    if target in NEEDS_POSIX:
        pytest.importorskip("fcntl", reason="Unix sockets and devices are for Unix")
    first = SystemRandom().randrange(10**9) if ALL else 0
    for number in range(first, first + EXAMPLES[target] * (20 if ALL else 1)):
        try:
            target(Random(number))
        except BaseException as error:
            error.add_note(f"{target.__name__}(Random({number}))")
            raise
