"""The controller watches the age of what it receives, and reports faults in time."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest

from steer_by_wire.controller.age_limits import NO_LIMIT_NS, AgeLimits
from steer_by_wire.controller.law_interface import LawOutput
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.safety_alarms import INTERVAL_NS
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import (
    ControllerFault,
    ControllerSafety,
    Freshness,
    Message,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from tests.support.frames.made_messages import error_of, message_with, motion_of
from tests.support.nodes.controller_link import Link, controller_settings

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
FTTI_NS = 150 * MS_NS
ON_WIRE_NS = 5 * MS_NS
"""Of the FTTI, for the wire and a late tick."""
NEVER_SEEN, FRESH, STALE = Freshness.NEVER_SEEN, Freshness.FRESH, Freshness.STALE
ALL: tuple[Message, ...] = (
    error_of(0.01),
    message_with(SteeringStatus, status=SteeringStatusCode.NO_COMMAND),
    motion_of(1.4),
)


def link_of_defaults(**tables: Any) -> Link:
    return Link(ControllerNode(controller_settings(supervision={}, **tables), 0))


def reported(link: Link, since_ns: int = 0) -> list[tuple[int, ControllerSafety]]:
    return [
        (time_ns, message)
        for time_ns, message, _ in link.sent
        if isinstance(message, ControllerSafety) and time_ns >= since_ns
    ]


def pass_by(link: Link, periods: int, messages: Sequence[Message] = ALL) -> None:
    """Let each period begin with these messages."""
    link.now_ns = link.node.deadline_ns
    for _ in range(periods):
        for message in messages:
            link.deliver(message)
        link.tick_until(link.now_ns + PERIOD_NS)


def refuse(link: Link) -> None:
    frame = encode(motion_of(1.4), 0)
    link.node.on_frame(frame._replace(data=bytes(8)), link.now_ns)


def freshness(message: ControllerSafety) -> tuple[Freshness, ...]:
    return (
        message.lateral_error_freshness,
        message.steering_status_freshness,
        message.vehicle_state_freshness,
    )


def test_without_anything_to_say_it_is_reported_ten_times_a_second() -> None:
    link = link_of_defaults()
    link.tick_until(1000 * MS_NS)
    expected = message_with(
        ControllerSafety,
        lateral_error_freshness=NEVER_SEEN,
        steering_status_freshness=NEVER_SEEN,
        vehicle_state_freshness=NEVER_SEEN,
    )
    assert reported(link) == [(100 * MS_NS * number, expected) for number in range(10)]


@pytest.mark.parametrize("silent", range(3))
def test_a_message_that_stops_is_reported_within_the_fault_tolerant_time(silent: int) -> None:
    link = link_of_defaults()
    pass_by(link, 100)
    stopped_ns = link.now_ns - PERIOD_NS
    others = [message for number, message in enumerate(ALL) if number != silent]
    pass_by(link, 30, others)
    of_it = [(at_ns, freshness(message)) for at_ns, message in reported(link, stopped_ns)]
    first_ns = next(at_ns for at_ns, ages in of_it if ages[silent] is STALE)
    assert 135 * MS_NS < first_ns - stopped_ns <= FTTI_NS - ON_WIRE_NS
    expected = tuple(STALE if number == silent else FRESH for number in range(3))
    assert {ages for at_ns, ages in of_it if at_ns >= first_ns} == {expected}
    pass_by(link, 1)
    back_ns = link.now_ns
    pass_by(link, 4)
    assert (FRESH,) * 3 in [
        freshness(message) for _, message in reported(link, back_ns - PERIOD_NS)
    ]


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_a_flood_of_bad_frames_is_answered_fifty_times_a_second(rate_hz: float) -> None:
    link = link_of_defaults(rate_hz=rate_hz)
    for _ in range(5000):
        refuse(link)
        link.tick_until(link.now_ns + MS_NS // 5)
    messages = reported(link)
    assert len(messages) == pytest.approx(50, abs=1)
    assert all(after[0] - before[0] >= INTERVAL_NS for before, after in pairwise(messages))
    assert messages[-1][1].rejected > 4800 % 4096


def test_refusals_before_the_node_are_reported_and_are_not_among_its_own() -> None:
    link = link_of_defaults()
    pass_by(link, 51)
    refuse(link)
    for _ in range(4):
        link.node.on_unauthenticated()
    pass_by(link, 3)
    assert reported(link)[-1][1].rejected == 5
    assert link.node.report()["rejected"] == {"bad_crc": 1}


def test_ticks_that_come_too_late_too_often_are_reported_as_a_fault() -> None:
    link = link_of_defaults(overruns={"overruns_max": 2, "window_ticks": 10})
    pass_by(link, 20)
    for _ in range(3):
        link.now_ns = link.node.deadline_ns + 2 * PERIOD_NS
        for message in ALL:
            link.deliver(message)
        link.keep(link.node.on_tick(link.now_ns))
    assert reported(link)[-1] == (link.now_ns, reported(link)[-1][1])
    assert reported(link)[-1][1].fault is ControllerFault.OVERRUNS


def test_a_law_that_fails_again_is_reported_as_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    link = link_of_defaults()
    pass_by(link, 20)

    def failing(_params: Any, state: Any, _seen: Any) -> tuple[Any, LawOutput]:
        return state, LawOutput(float("nan"), 0.0, 0.0, 0.0)

    law = link.node._law
    monkeypatch.setattr(law, "design", law.design._replace(step=failing))
    pass_by(link, 1)
    assert reported(link)[-1][1].fault is ControllerFault.NONE
    pass_by(link, 20)
    faults = [(at_ns, message.fault) for at_ns, message in reported(link)]
    assert link.node.report()["failure"]
    assert faults[-1][1] is ControllerFault.LAW_FAILED


def test_age_limits_follow_from_the_fault_tolerant_time_or_are_given() -> None:
    def of(**supervision: object) -> AgeLimits:
        return controller_settings(supervision=supervision).age_limits

    assert of() == AgeLimits(135 * MS_NS, 135 * MS_NS, 135 * MS_NS)
    given = of(steering_status_timeout_ms=40.0, vehicle_state_timeout_ms=60.0)
    assert given == AgeLimits(135 * MS_NS, 40 * MS_NS, 60 * MS_NS)
    assert of(vehicle_state_timeout_ms="off").vehicle_state_ns == NO_LIMIT_NS


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("steering_status_timeout_ms", 136.0, "supervision.steering_status_timeout_ms = 136"),
        ("vehicle_state_timeout_ms", 136.0, "supervision.vehicle_state_timeout_ms = 136"),
        ("vehicle_state_timeout_ms", 0.5, "greater than or equal to 1"),
        ("vehicle_state_timeout_ms", "never", "off"),
        ("steering_status_timeout_ms", "off", "number"),
    ],
)
def test_an_age_limit_that_cannot_be_kept_is_refused(key: str, value: object, text: str) -> None:
    settings = {"law": "pd", "pd": {"proportional_gain_rad_m": 1.0, "derivative_gain_rad_s_m": 0.0}}
    with pytest.raises(ValueError, match=text):
        ControllerSettings.model_validate({**settings, "supervision": {key: value}})
