"""Every kind of fault is detected by what must detect it, and answered within its time.

The times are those of virtual time. Rules that need another run have their own tests: missed
periods (``test_missed_periods``), a silent peer in real processes (``test_two_processes``).
"""

from collections.abc import Sequence
from functools import cache

import pytest

from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    decode,
)
from steer_by_wire.plant_emulator.faults.settings import STEERING_FAULTS, FaultKind
from steer_by_wire.runtime.frame import Frame
from tests.support.runs.fault_cases import (
    DETECTED,
    UNDETECTED,
    UNRECEIVED,
    Case,
    FaultyRun,
    counts_of,
    run_with,
)

FTTI_S = 0.15
"""The fault tolerant time interval of both nodes' settings."""
LATENCY_S = 0.05
DELAYED = (f"latency.downlink.mean_s={LATENCY_S}", "latency.uplink.mean_s=0.03")
LOSING = ("bit_flips", "wrong_length", "wrong_identifier", "out_of_range", "drop")
"""Kinds after which a frame that they have changed must not be used."""


def ids(case: Case) -> str:
    return f"{case.kind} {case.message} {case.magnitude:g}"


@cache
def golden(law: str = "practical_pd_ddob", plant: Sequence[str] = ()) -> FaultyRun:
    return run_with((), law, plant)


@cache
def faulty(case: Case, law: str = "practical_pd_ddob", plant: Sequence[str] = ()) -> FaultyRun:
    return run_with([case.settings], law, plant)


def newest(frames: Sequence[Frame], kind: type) -> object:
    """The last message of a kind on the bus."""
    data = next(frame for frame in reversed(frames) if frame.can_id == CAN_IDS[kind])
    decoded = decode(data)
    assert isinstance(decoded, Decoded)
    return decoded.message


def assert_detected(case: Case, run: FaultyRun, latency_s: float = 0.0) -> None:
    """Demand a count within the FTTI of the first frame that the fault changed."""
    is_down = case.settings.direction == "downlink"
    receiver = run.plant if is_down else run.controller
    effect_s = run.edge.report()["faults"][0]["first_s"]
    since_s = {name: 1e-9 * at_ns - effect_s for name, at_ns in receiver.first_ns.items()}
    # What the actuator has is affected one latency after the frame on the bus.
    limit_s = FTTI_S + latency_s * is_down
    assert min(since_s.values()) > -1e-3, "nothing is counted before the fault"
    assert min(since_s[name] for name in case.counts if name in since_s) <= limit_s
    if case.leaves:
        assert since_s["held"] <= limit_s
    elif case.leaves is not None:
        assert "held" not in since_s


@pytest.mark.parametrize("case", DETECTED, ids=ids)
def test_it_is_counted_and_answered_in_time(case: Case) -> None:
    assert_detected(case, faulty(case))


@pytest.mark.parametrize("case", [case for case in DETECTED if case.leaves], ids=ids)
def test_so_it_is_behind_a_network(case: Case) -> None:
    assert_detected(case, faulty(case, "practical_predictor", DELAYED), LATENCY_S)


@pytest.mark.parametrize("case", [*DETECTED, *UNDETECTED], ids=ids)
def test_both_nodes_are_in_control_again_after_it(case: Case) -> None:
    frames = faulty(case).frames
    command, status = newest(frames, SteeringCommand), newest(frames, SteeringStatus)
    assert isinstance(command, SteeringCommand)
    assert isinstance(status, SteeringStatus)
    assert (command.mode, status.status) == (Mode.ACTIVE, SteeringStatusCode.APPLYING)


@pytest.mark.parametrize(
    "case", [case for case in DETECTED if case.kind in LOSING and case.counts != ("held",)], ids=ids
)
def test_no_changed_frame_is_used(case: Case) -> None:
    receiver = "plant" if case.settings.direction == "downlink" else "controller"
    accepted = [getattr(run, receiver).report()["accepted"] for run in (golden(), faulty(case))]
    assert accepted[0] - accepted[1] == faulty(case).edge.report()["faults"][0]["changed"]


@pytest.mark.parametrize("case", UNDETECTED, ids=ids)
def test_what_nothing_can_detect_is_not_counted(case: Case) -> None:
    run = faulty(case)
    assert run.edge.report()["faults"][0]["changed"] > 0
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}


@pytest.mark.parametrize("case", UNRECEIVED, ids=ids)
def test_a_fault_of_a_message_that_no_node_receives_changes_no_command(case: Case) -> None:
    run, command = faulty(case), CAN_IDS[SteeringCommand]
    assert run.edge.report()["faults"][0]["changed"] > 0
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}
    with_fault, without = (
        [frame for frame in one.frames if frame.can_id == command] for one in (run, golden())
    )
    assert with_fault == without


@pytest.mark.parametrize(
    ("law", "plant"), [("practical_pd_ddob", ()), ("practical_predictor", DELAYED)]
)
def test_without_a_fault_nothing_is_counted(law: str, plant: Sequence[str]) -> None:
    run = golden(law, plant)
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}


def test_every_kind_is_among_the_cases() -> None:
    assert {case.kind for case in (*DETECTED, *UNDETECTED)} == set(FaultKind) - STEERING_FAULTS
