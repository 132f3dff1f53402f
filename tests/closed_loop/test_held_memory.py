"""Memory kept of every period is found; ``python -m tests.support.held_memory`` takes longer."""

from collections.abc import Sequence

import pytest

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.faults.stage import FaultStage
from steer_by_wire.runtime.frame import Frame
from tests.support.held_memory import GROWTH_BYTES_MAX, measure_memory

LAW = controller_preset("practical_pd")


def test_the_bytes_held_are_the_same_again_and_more_where_a_stage_keeps_its_frames(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sound, again = measure_memory(LAW, 2.0), measure_memory(LAW, 2.0)
    assert abs(again.late_bytes - sound.late_bytes) < 1000
    take = FaultStage.take

    def keeping(stage: FaultStage, frame: Frame, now_ns: int, since_ns: int) -> Sequence[Frame]:
        vars(stage).setdefault("kept", []).append(now_ns)
        return take(stage, frame, now_ns, since_ns)

    monkeypatch.setattr(FaultStage, "take", keeping)
    assert measure_memory(LAW, 2.0).growth_bytes - sound.growth_bytes > GROWTH_BYTES_MAX
