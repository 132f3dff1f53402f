"""Live view of the plant: steering, the controller's word, a latency changed live, limits."""

import pytest

from steer_by_wire.dbc.messages import Direction, LatencyModel
from tests.support.frames.made_messages import latency_of
from tests.support.nodes.plant_link import MS_NS, START_NS, Link, link, steered


def states(tested: Link, now_ns: int) -> dict[str, str]:
    return {name: text for name, text in tested.node.view(now_ns).states.items() if text}


def test_commands_that_stop_are_shown_as_a_hold_and_a_fallback() -> None:
    tested = link()
    assert states(tested, START_NS)["mode"] == "waiting for the first command"
    tested.command(START_NS, 0.1)
    tested.tick_until(START_NS + 20 * MS_NS)
    assert states(tested, START_NS)["mode"].startswith("FOLLOWING")
    tested.tick_until(START_NS + 300 * MS_NS)
    assert states(tested, START_NS)["mode"].startswith("HOLDING")
    tested.tick_until(START_NS + 2000 * MS_NS)
    assert states(tested, START_NS)["mode"].startswith("FALLBACK")


def test_a_latency_changed_live_is_shown() -> None:
    tested = steered(3)
    assert "intervention" not in states(tested, 0)
    tested.configure(
        START_NS + 40 * MS_NS,
        latency_of(Direction.DOWNLINK, 0.08, 0.03, 0.01, model=LatencyModel.GAMMA),
    )
    assert states(tested, 0)["intervention"] == (
        "intervention 1 over the bus: latency downlink gamma 80 ± 30 ms, 1 % lost "
        "at 0.036 s of motion, by 320#4120032C016400 (sender by DBC: TOOL)"
    )


@pytest.mark.parametrize(("angle_rad_max", "is_limited"), [(0.05, True), (0.7, False)])
def test_who_limits_commands_is_shown(angle_rad_max: float, is_limited: bool) -> None:
    tested = steered(20, safety={"angle_rad_max": angle_rad_max})
    limited = [name for name in tested.node.view(0).counts if name.startswith("commands limited")]
    assert bool(limited) is is_limited
