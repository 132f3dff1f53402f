"""Random walks of faults: the same on any number of processes, and shortened where they fail."""

import json
import os
import shlex
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import pytest

from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.tools.faults.campaign.detectability import MECHANISM_OF, Mechanism
from steer_by_wire.tools.faults.campaign.node_faults import NodeFault
from steer_by_wire.tools.faults.campaign.specification import (
    CampaignSettings,
    CaseSettings,
    NodeCaseSettings,
    NodeFaultKind,
    PointSettings,
)
from steer_by_wire.tools.faults.campaign.walks import (
    WALK_FAULTS_MAX,
    Walk,
    draw_walk,
    one_walk,
    shorten,
    walk_all,
    walk_lines,
)
from steer_by_wire.tools.faults.program import FAILED, main

FEW_KINDS = (
    CaseSettings(kind=FaultKind.DROP, messages=("LATERAL_ERROR",), magnitudes=(0.5, 1.0)),
    CaseSettings(kind=FaultKind.BIT_FLIPS, messages=("LATERAL_ERROR",), magnitudes=(0.02,)),
    CaseSettings(kind=FaultKind.OFFSET, messages=("STEERING_COMMAND",), magnitudes=(0.03,)),
)
NODE_KINDS = (
    NodeCaseSettings(kind=NodeFaultKind.KILLED, nodes=("controller", "plant")),
    NodeCaseSettings(kind=NodeFaultKind.PAUSED, nodes=("controller", "plant")),
    NodeCaseSettings(kind=NodeFaultKind.BUS_OFF, nodes=("controller", "plant")),
    NodeCaseSettings(kind=NodeFaultKind.CLOCK_JUMP, nodes=("controller",), magnitudes=(0.3,)),
    NodeCaseSettings(kind=NodeFaultKind.BABBLING, nodes=("bus",)),
)
POINT = PointSettings(name="delay", downlink_ms=60.0, uplink_ms=40.0)


@pytest.fixture(scope="module")
def spec() -> CampaignSettings:
    return CampaignSettings(laws=("practical_pd",), points=(POINT,), cases=FEW_KINDS, seed=5)


@pytest.fixture
def strict_acceptance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what is seen by CRC and counter no longer count as seen."""
    strict: Mapping[str, Mechanism] = MappingProxyType(
        {cause: by for cause, by in MECHANISM_OF.items() if by is not Mechanism.E2E}
    )
    monkeypatch.setattr("steer_by_wire.tools.faults.campaign.walk_judgement.MECHANISM_OF", strict)


@pytest.fixture(scope="module")
def alone(spec: CampaignSettings) -> list[Walk]:
    """Three walks on one process."""
    walks: list[Walk] = []
    walk_all(spec, 3, 1, walks.append)
    return walks


def test_a_walk_is_a_function_of_its_seed(spec: CampaignSettings, alone: list[Walk]) -> None:
    for walk in alone:
        assert walk.failure == ""
        assert 2 <= len(walk.faults) <= WALK_FAULTS_MAX
    assert one_walk(spec, alone[1].seed) == alone[1]


def test_walks_are_the_same_on_one_process_and_on_two(
    spec: CampaignSettings, alone: list[Walk]
) -> None:
    shared: list[Walk] = []
    walk_all(spec, 3, 2, shared.append)
    assert [walk.seed for walk in alone] == [5, 6, 7]
    assert sorted(shared, key=lambda walk: walk.seed) == alone
    assert walk_lines(shared, "again") == walk_lines(alone, "again")


def test_walks_draw_faults_of_messages_and_of_nodes_and_one_babbling_node_at_most(
    spec: CampaignSettings,
) -> None:
    both = spec.model_copy(update={"node_cases": NODE_KINDS})
    walks = [draw_walk(both, seed) for seed in range(300)]
    assert {fault.kind for walk in walks for fault in walk.faults} == {
        *(table.kind for table in FEW_KINDS),
        *NodeFaultKind,
    }
    babbling = [[one.kind for one in walk.faults].count(NodeFaultKind.BABBLING) for walk in walks]
    assert max(babbling) == 1
    only_babbling = spec.model_copy(update={"cases": (), "node_cases": NODE_KINDS[-1:]})
    assert len(draw_walk(only_babbling, 1).faults) == 1


class Failing:
    """Fails for parts that are one of some sets, and remembers what it was asked."""

    def __init__(self, *sets: set[int]) -> None:
        self._sets = sets
        self.asked: list[tuple[int, ...]] = []

    def __call__(self, part: Sequence[int]) -> str:
        self.asked.append(tuple(part))
        return f"{len(part)} fail" if set(part) in self._sets else ""


def test_a_failing_sequence_is_shortened_to_the_shortest_there_is() -> None:
    """Also where no sequence in between fails: from it, leaving out one by one leads nowhere."""
    assert shorten((0, 1, 2), Failing({0, 1, 2}, {2})) == ((2,), "1 fail")
    assert shorten((0, 1, 2, 3, 4), Failing({0, 1, 2}, {3, 4})) == ((3, 4), "2 fail")
    assert shorten((0, 1), Failing(set(), {0, 1})) == ((), "0 fail")


def test_a_sequence_of_which_no_part_fails_has_been_tried_in_every_part() -> None:
    failing = Failing(set(range(6)))
    assert shorten(range(6), failing) is None
    assert len(set(failing.asked)) == len(failing.asked) == 2**6 - 1
    assert [len(part) for part in failing.asked] == sorted(len(part) for part in failing.asked)


@pytest.mark.usefixtures("strict_acceptance")
def test_a_walk_that_fails_is_reported_by_the_one_fault_that_does_it(
    spec: CampaignSettings,
) -> None:
    walks: list[Walk] = []
    walk_all(spec, 2, 1, walks.append)
    failed = [walk for walk in walks if walk.failure]
    assert failed
    assert {walk.shortest_failure for walk in failed} == {"the controller counted nothing"}
    for walk in failed:
        assert len(walk.shortest) == 1 < len(walk.faults)
        assert walk.shortest[0] in walk.faults


def test_all_that_it_takes_to_run_a_failing_walk_again_is_printed() -> None:
    stage = FaultSettings(
        kind=FaultKind.DROP, direction="uplink", message="LATERAL_ERROR", onset_s=1.5
    )
    killed = NodeFault(NodeFaultKind.KILLED, "plant", 2.0, 0.5)
    walk = Walk(7, POINT, "practical_pd", (stage, killed), "both are bad", (killed,), "it is dead")
    lines = walk_lines([walk, walk._replace(seed=9, failure="")], "python -m x")
    assert lines[0] == "2 walks of 4 faults in all: 1 failed"
    assert lines[2] == "seed 7: it is dead (1 of the 2 faults)"
    assert lines[3] == "  all 2 together: both are bad"
    assert lines[4].startswith("  law practical_pd, point {")
    assert PointSettings.model_validate_json(lines[4].partition("point ")[2]) == POINT
    assert NodeFault(**json.loads(lines[5])) == killed
    assert lines[6] == "  again: python -m x --set seed=7"
    assert len(lines) == 7


def test_the_command_that_is_printed_runs_the_same_walk_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a spec.toml"
    file.write_text('[[node_cases]]\nkind = "killed"\nnodes = ["plant"]\n')
    monkeypatch.setattr("steer_by_wire.tools.faults.campaign.walks.failure_of", lambda *_: "always")
    point = "points=[{name=\"a 'b'\", speed_m_s=1.1}]"
    first = [str(file), "--set", "seed=40", "--set", point, "--random-walks", "3"]
    assert main([*first, "--processes", "1"]) == FAILED
    printed = capsys.readouterr().out
    commands = [line for line in printed.splitlines() if line.startswith("  again: ")]
    assert len(commands) == 3
    words = shlex.split(commands[1].partition(": ")[2])
    assert words[:2] == ["steer-by-wire", "faults"]
    assert main([*words[2:], "--processes", "1"]) == FAILED
    again = capsys.readouterr().out
    assert again.splitlines()[2:] == printed.split("\n\n")[2].splitlines()


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--out", "x"], "--out"),
        (["--live"], "--live"),
        (["--compare", "x"], "--compare"),
        (["--set", "cases=[]", "--set", "node_cases=[]"], "--random-walks: there are no cases"),
        (["--set", f"seed={2**31}"], f"seed + N must be up to {2**31 + 1}"),
    ],
)
def test_what_is_nothing_for_walks_is_refused_in_one_line(
    arguments: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--random-walks", "2"]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert reported in error


def test_a_file_that_a_point_names_and_that_is_not_there_is_no_failing_walk(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "none.csv"
    point = f'points=[{{name="a", path={{kind="waypoints", file="{missing}"}}}}]'
    assert main(["--set", point, "--random-walks", "1", "--processes", "1"]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"steer-by-wire faults: error: {missing}: cannot be read: No such file or directory"
    ]


def test_failures_end_with_status_one_and_ctrl_c_keeps_what_was_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Walk(7, POINT, "practical_pd", (), "a node is not in control again")

    def work(_spec: CampaignSettings, seed: int) -> Walk:
        if seed == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return found._replace(seed=seed)

    monkeypatch.setattr("steer_by_wire.tools.faults.campaign.walks.one_walk", work)
    assert main(["--random-walks", "2", "--processes", "1"]) == FAILED
    assert capsys.readouterr().out.startswith("2 walks of 0 faults in all: 2 failed\n")
    assert main(["--random-walks", "9", "--processes", "1"]) == 130
    printed = capsys.readouterr()
    assert printed.out.startswith("2 walks of 0 faults in all: 2 failed\n")
    assert printed.err == "steer-by-wire faults: error: interrupted\n"
