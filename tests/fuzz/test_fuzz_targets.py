"""Any bytes into whatever reads bytes: the targets of ``tests.fuzz``, with hypothesis.

Each target documents what it promises. The examples are the same in every run; atheris searches for
new ones, and its findings are kept below.
"""

from random import Random

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.fuzz.targets import TARGETS
from tests.support.suite.combinations import sampled

EXAMPLES = {
    "authentication": 15,
    "broker": 25,
    "bus_client": 20,
    "command_line": 20,
    "controller": 20,
    "log": 20,
    "plant": 15,
    "results": 10,
    "settings": 20,
    "specification": 10,
    "trace": 10,
    "waypoints": 6,
}
"""How many of each, so that all together take seconds."""
EACH = sampled(1, 20)
LENGTHS = (40, 400, 1500)
NEEDS_POSIX = {"broker", "bus_client", "command_line"}
FOUND = {
    # A point with a law twice: two runs of one name.
    "specification": ("2545cfd2cf4f3173706f6f66cfcfcf",),
    # Two points so near each other, and others so far away, that both had one place on the path.
    "waypoints": ("da0000010000000000991163489ef516810100008feed461ba7200b4598f671c3718102c35a4",),
}
"""Inputs that once broke a promise, by target."""


def needs(name: str) -> None:
    if name in NEEDS_POSIX:
        pytest.importorskip("fcntl", reason="Unix sockets and devices are for Unix")


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_no_bytes_break_a_promise(name: str) -> None:
    needs(name)

    @settings(
        max_examples=EACH * EXAMPLES[name],
        derandomize=EACH == 1,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=tuple(HealthCheck),
    )
    @given(st.binary(max_size=300))
    def small(data: bytes) -> None:
        TARGETS[name](data)

    small()


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_no_long_noise_breaks_a_promise(name: str) -> None:
    """hypothesis prefers short inputs; these are as long as a run of a second."""
    needs(name)
    random = Random(name)
    for index in range(EACH * EXAMPLES[name] // 2):
        TARGETS[name](random.randbytes(LENGTHS[index % len(LENGTHS)]))


@pytest.mark.parametrize(
    ("name", "found"), [(name, found) for name, all_of in FOUND.items() for found in all_of]
)
def test_what_broke_a_promise_once_breaks_none_now(name: str, found: str) -> None:
    TARGETS[name](bytes.fromhex(found))


def test_every_target_is_run_here() -> None:
    assert set(TARGETS) == set(EXAMPLES)
