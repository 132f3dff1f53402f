"""Random walks of faults: the same on any number of processes, and shortened where they fail."""

import os
import signal
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import pytest

from plant_emulator.fault_settings import FaultKind, FaultSettings
from tools.campaign.detectability import MECHANISM_OF, Mechanism
from tools.campaign.specification import CampaignSettings, CaseSettings, PointSettings
from tools.campaign.walks import Walk, one_walk, shorten, walk_all, walk_lines
from tools.fault_campaign import FAILED, main

FEW_KINDS = (
    CaseSettings(kind=FaultKind.DROP, messages=("LATERAL_ERROR",), magnitudes=(0.5, 1.0)),
    CaseSettings(kind=FaultKind.BIT_FLIPS, messages=("LATERAL_ERROR",), magnitudes=(0.02,)),
    CaseSettings(kind=FaultKind.OFFSET, messages=("STEERING_COMMAND",), magnitudes=(0.03,)),
)


@pytest.fixture(scope="module")
def spec() -> CampaignSettings:
    points = (PointSettings(name="delay", downlink_ms=60.0, uplink_ms=40.0),)
    return CampaignSettings(laws=("practical_pd",), points=points, cases=FEW_KINDS, seed=5)


@pytest.fixture
def strict_acceptance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what is seen by CRC and counter no longer count as seen."""
    strict: Mapping[str, Mechanism] = MappingProxyType(
        {cause: by for cause, by in MECHANISM_OF.items() if by is not Mechanism.E2E}
    )
    monkeypatch.setattr("tools.campaign.walks.MECHANISM_OF", strict)


def test_a_walk_is_a_function_of_its_seed(spec: CampaignSettings) -> None:
    walk = one_walk(spec, 11)
    assert walk.failure == ""
    assert 2 <= len(walk.faults) <= 6
    assert one_walk(spec, 11) == walk


def test_walks_are_the_same_on_one_process_and_on_two(spec: CampaignSettings) -> None:
    alone: list[Walk] = []
    walk_all(spec, 3, 1, alone.append)
    shared: list[Walk] = []
    walk_all(spec, 3, 2, shared.append)
    assert [walk.seed for walk in alone] == [5, 6, 7]
    assert sorted(shared) == alone
    assert walk_lines(shared) == walk_lines(alone)


def test_a_failing_sequence_is_shortened_to_what_it_takes() -> None:
    faults = [
        FaultSettings(kind=FaultKind.DROP, direction="uplink", onset_s=float(second))
        for second in range(6)
    ]

    def fails(part: Sequence[FaultSettings]) -> bool:
        return {1.0, 4.0} <= {fault.onset_s for fault in part}

    assert [fault.onset_s for fault in shorten(faults, fails)] == [1.0, 4.0]


@pytest.mark.usefixtures("strict_acceptance")
def test_a_walk_that_fails_is_told_by_the_one_fault_that_does_it(spec: CampaignSettings) -> None:
    walks: list[Walk] = []
    walk_all(spec, 2, 1, walks.append)
    failed = [walk for walk in walks if walk.failure]
    assert failed
    assert {walk.failure for walk in failed} == {"the controller counted nothing"}
    for walk in failed:
        assert len(walk.shortest) == 1 < len(walk.faults)
        assert walk.shortest[0] in walk.faults
    lines = walk_lines(walks)
    assert lines[0].endswith(f": {len(failed)} failed")
    assert lines[2].strip() == failed[0].shortest[0].model_dump_json(exclude_none=True)


def test_failures_end_with_status_one_and_ctrl_c_keeps_what_was_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Walk(7, (), "a node is not in control again", ())

    def work(_spec: CampaignSettings, seed: int) -> Walk:
        if seed == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return found._replace(seed=seed)

    monkeypatch.setattr("tools.campaign.walks.one_walk", work)
    assert main(["--random-walks", "2", "--processes", "1"]) == FAILED
    assert capsys.readouterr().out.startswith("2 walks of 0 faults in all: 2 failed\n")
    assert main(["--random-walks", "9", "--processes", "1"]) == 130
    printed = capsys.readouterr()
    assert printed.out.startswith("2 walks of 0 faults in all: 2 failed\n")
    assert printed.err == "fault_campaign: error: interrupted\n"
