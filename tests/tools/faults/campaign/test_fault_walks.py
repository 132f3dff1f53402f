"""Random walks of faults: whatever overlaps, the pair meets the conditions of its judge.

``WALKS=2000 python -m pytest tests/tools/faults/campaign/test_fault_walks.py`` tries more of them.
"""

import os
from collections.abc import Mapping
from types import MappingProxyType

import pytest
from hypothesis import HealthCheck, given, settings

from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings, NodeFaultKind
from steer_by_wire.tools.faults.campaign.detectability import MECHANISM_OF, Mechanism
from tests.support.attacks.fault_walks import Walk, failure_of, walks

SPEC = load_settings(CampaignSettings, read_preset("steer_by_wire.tools.faults", "default"))
WALKS = int(os.environ.get("WALKS", "4"))
FLIPS = FaultSettings(
    kind=FaultKind.BIT_FLIPS, direction="uplink", message="LATERAL_ERROR", onset_s=2.0,
    duration_s=0.5, magnitude=0.02,
)  # fmt: skip


@settings(
    max_examples=WALKS,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=tuple(HealthCheck),
)
@given(walks(SPEC))
def test_a_pair_meets_the_conditions_of_any_walk(walk: Walk) -> None:
    assert failure_of(SPEC, walk) == ""


def test_walks_are_drawn_of_every_kind() -> None:
    kinds: set[str] = set()

    @settings(max_examples=200, derandomize=True, deadline=None, database=None)
    @given(walks(SPEC))
    def draw(walk: Walk) -> None:
        kinds.update(fault.kind for fault in walk.faults)

    draw()
    assert kinds == {*FaultKind, *NodeFaultKind}


def test_a_walk_that_is_noticed_by_crc_and_counter_alone_fails_without_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    walk = Walk(1, SPEC.points[0], "practical_pd", (FLIPS,))
    assert failure_of(SPEC, walk) == ""
    without: Mapping[str, Mechanism] = MappingProxyType(
        {cause: by for cause, by in MECHANISM_OF.items() if by is not Mechanism.E2E}
    )
    monkeypatch.setattr("tests.support.attacks.walk_judgement.MECHANISM_OF", without)
    assert failure_of(SPEC, walk) == "the controller counted nothing"
