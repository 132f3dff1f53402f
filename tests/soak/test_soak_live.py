"""The soak of real processes, judged by what a late machine cannot change."""

from itertools import pairwise
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair_result import CONTROLLER, PLANT
from steer_by_wire.closed_loop.reports.findings import Finding
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.node import NS_PER_S
from tests.soak.__main__ import record_of
from tests.soak.babbling_node import GAPS, LOWEST_PRIORITY_IDS
from tests.soak.findings import (
    between_findings,
    bounds_ns,
    load_findings,
)
from tests.soak.memory_growth import figures_of
from tests.soak.soak_run import LiveSoak, SoakSettings, run_live_soak


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> LiveSoak:
    """With a rest bus, too."""
    bus = BusSettings(load=0.3)
    soak = SoakSettings(LOWEST_PRIORITY_IDS, 1.0, settle_s=0.5, recover_s=0.5, bus=bus, priority=0)
    return run_live_soak(soak, tmp_path_factory.mktemp("soak"))


def findings(run: LiveSoak) -> dict[str, Finding]:
    return {finding.what: finding for finding in load_findings(run)}


STRUCTURAL = (
    "no frame of the pair lost or reordered",
    "none missed by its receiver",
    "recorder complete",
    "nobody disconnected",
)
"""What holds on a machine that stalls, too."""


@pytest.mark.parametrize("what", STRUCTURAL)
def test_processes_on_a_full_bus_lose_nothing(live: LiveSoak, what: str) -> None:
    finding = findings(live)[what]
    assert finding.holds, finding.figure


def test_the_babbling_node_and_the_pair_were_there(live: LiveSoak) -> None:
    assert live.bus.babbled > 100
    assert live.bus.others > 100
    assert {message.name for message in live.messages} >= {"SteeringCommand", "LateralError"}
    assert all(message.sent for message in live.messages)
    assert {"broker", "babbler", PLANT, f"{PLANT}: file writer", CONTROLLER} <= set(live.memory)


@pytest.fixture(scope="module")
def between(tmp_path_factory: pytest.TempPathFactory) -> LiveSoak:
    """With identifiers that starve all status: 64 of these fill a queue within 2.2 s."""
    soak = SoakSettings(tuple(GAPS[3][:4]), babble_s=3.0, settle_s=0.5, recover_s=0.5, priority=0)
    return run_live_soak(soak, tmp_path_factory.mktemp("between"))


@pytest.mark.parametrize(
    "what",
    [
        "nothing of higher priority lost",
        "what the bus took is sent, in order",
        "recorder complete",
        "nobody disconnected",
    ],
)
def test_status_that_is_starved_holds_up_no_command(between: LiveSoak, what: str) -> None:
    finding = {finding.what: finding for finding in between_findings(between)}[what]
    assert finding.holds, finding.figure


def test_every_finding_between_the_pairs_own_priorities_can_fail(between: LiveSoak) -> None:
    broker = between.reports["broker"]
    delays = broker["channels"]["can0"]["arbitration_delay"]
    late = {**delays, "100": {**delays["100"], "p99_s": 271e-6}}
    channel = {**broker["channels"]["can0"], "arbitration_delay": late}
    reports = {**between.reports, "broker": {**broker, "channels": {"can0": channel}}}
    clients = {**broker["clients"], "disconnected": {"garbage": 1}}
    thrown = {**between.reports, "broker": {**broker, "clients": clients}}
    spoilt = {
        "priority kept": between._replace(reports=reports),
        "nothing of higher priority lost": with_first(between, lost=10**6),
        "what the bus took is sent, in order": with_first(between, is_same=False),
        "recorder complete": between._replace(bus=between.bus._replace(frames=1)),
        "nobody disconnected": between._replace(reports=thrown),
    }
    assert set(spoilt) == {finding.what for finding in between_findings(between)}
    for what, run in spoilt.items():
        assert not {finding.what: finding for finding in between_findings(run)}[what].holds, what


def with_loops(run: LiveSoak, controller: dict[str, Any], plant: dict[str, Any]) -> LiveSoak:
    """The same run with other figures of the two loops."""
    changed = {CONTROLLER: controller, PLANT: plant}
    reports = {
        name: {**run.reports[name], "loop": {**run.reports[name]["loop"], **loop}}
        for name, loop in changed.items()
    }
    return run._replace(reports={**run.reports, **reports})


def with_refused(run: LiveSoak, count: int) -> LiveSoak:
    """The same run with ``count`` frames of the controller for which there was no room."""
    return with_loops(run, {"frames_refused": count}, {"frames_refused": 0})


def with_first(run: LiveSoak, **changed: object) -> LiveSoak:
    """The same run but for the first message."""
    first, *rest = run.messages
    return run._replace(messages=[first._replace(**changed), *rest])  # type: ignore[arg-type]


def test_every_finding_can_fail(live: LiveSoak) -> None:
    """A verdict that nothing turns is none."""
    broker = live.reports["broker"]
    channel = broker["channels"]["can0"]
    late = {**channel["arbitration_delay"]}
    late["100"] = {**late["100"], "p99_s": (bounds_ns(live)[0x100] + 1) / NS_PER_S}
    clients = {**broker["clients"], "disconnected": {"left": 4, "garbage": 1}}

    def with_broker(**changed: object) -> LiveSoak:
        return live._replace(reports={**live.reports, "broker": {**broker, **changed}})

    spoilt = {
        "bus full": live._replace(bus=live.bus._replace(load=0.99)),
        "room for every frame": with_refused(live, 1),
        "no frame of the pair lost or reordered": with_first(live, is_same=False),
        "none missed by its receiver": with_first(live, is_run=False),
        "priority kept": with_broker(
            channels={"can0": {**channel, "arbitration_delay": late}},
        ),
        "controller in control throughout": live._replace(
            modes=[*live.modes, (1.0, "HOLDING", 0.0)]
        ),
        "recorder complete": live._replace(bus=live.bus._replace(frames=live.bus.frames - 1)),
        "memory flat": live._replace(
            memory={"leak": figures_of([(float(s), 100 * s) for s in range(100)])}
        ),
        "nobody disconnected": with_broker(clients=clients),
    }
    assert set(spoilt) == set(findings(live))
    for what, run_spoilt in spoilt.items():
        assert not findings(run_spoilt)[what].holds, what


def test_a_frame_without_room_takes_its_counter_with_it_and_is_no_frame_lost(
    live: LiveSoak,
) -> None:
    """Where a stalled machine does not run the broker, the sockets of the programs fill up."""
    lost, missed = "no frame of the pair lost or reordered", "none missed by its receiver"
    whole = live._replace(messages=[one._replace(lost=0, missed=0) for one in live.messages])
    for count in (0, 1, 6):
        gone = with_first(with_refused(whole, count), lost=count, missed=count)
        assert findings(gone)["room for every frame"].holds is (count == 0)
        assert findings(gone)[lost].holds
        assert findings(gone)[missed].holds
        assert not findings(with_first(gone, lost=count + 1))[lost].holds
        assert not findings(with_first(gone, reordered=1))[lost].holds
        assert not findings(with_first(gone, missed=count + 1))[missed].holds
        assert not findings(with_first(gone, disordered=1))[missed].holds


def test_priority_is_judged_by_the_stalls_that_were_measured(live: LiveSoak) -> None:
    broker = live.reports["broker"]
    channel = broker["channels"]["can0"]

    def kept(max_s: float, stall_s: float) -> bool:
        delays = {
            can_id: {"p99_s": 0.0, "max_s": max_s if can_id == "100" else 0.0}
            for can_id in channel["arbitration_delay"]
        }
        punctual = {"lateness": {"max_s": 0.0}}
        reports = {
            **live.reports,
            "broker": {
                **broker,
                "lateness": {"max_s": stall_s},
                "channels": {"can0": {**channel, "arbitration_delay": delays}},
            },
        }
        quiet = live.settings._replace(bus=BusSettings())
        run = with_loops(live._replace(settings=quiet, reports=reports), punctual, punctual)
        return bool(findings(run)["priority kept"].holds)

    assert kept(269e-6, 0.0)
    assert not kept(271e-6, 0.0)
    assert not kept(271e-6, 7.5e-3)
    assert kept(271e-6, 7.6e-3)  # with the longest wait of 2.43 ms it is a period
    assert kept(539e-6, 11e-3)
    assert not kept(541e-6, 11e-3)
    assert kept(1889e-6, 62e-3)
    assert not kept(1891e-6, 62e-3)


def test_the_figures_hold_every_message_in_order_of_its_bound(live: LiveSoak) -> None:
    found = list(load_findings(live))
    record = record_of(live, found)
    assert [row["name"] for row in record["messages"]] == [m.name for m in live.messages]
    bounds = [row["arbitration"]["bound_s"] for row in record["messages"]]
    assert all(after > before for before, after in pairwise(bounds))
