"""Refused frames of a healthy pair after its host has held up plant, controller or bus.

In virtual time: what is held up takes all that has come meanwhile when it goes on, at one instant,
as a process after SIGSTOP and SIGCONT on a bus without arrival times.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.virtual_time_loop import InstantWire, VirtualTimeExecutor
from tests.support.nodes.held_up import HeldUp, Stall

MS = 1_000_000
DURATION_S = 5.0
TRANSMIT_BUFFER = 12
"""Frames that a network interface, or a client of the emulated bus, keeps of a node."""
_NO_STALL = (0, 0)


class HeldUpWire(InstantWire):
    """A bus that is held up: of each sender it keeps what the transmit buffer has room for."""

    def __init__(self, stall: Stall) -> None:
        super().__init__()
        self._first_ns, self._end_ns = stall
        self._kept = [0, 0]

    def submit(self, frames: Sequence[Frame], sender: int, now_ns: int) -> None:
        is_held_up = self._first_ns <= now_ns < self._end_ns
        if is_held_up:
            room = TRANSMIT_BUFFER - self._kept[sender]
            self._kept[sender] += len(frames)
            frames = frames[: max(room, 0)]
        super().submit(frames, sender, now_ns)
        if is_held_up:
            self.next_event_ns = self._end_ns


def reports_of(
    held_up: str,
    first_ms: int,
    stall_ms: int,
    latency_s: float = 0.0,
    preset: str = "practical_pd",
    duration_s: float = DURATION_S,
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Run a pair, one part of which is held up once; returns the plant's and the controller's."""
    latency = BothLatencySettings(downlink=LatencySettings(mean_s=latency_s))
    _, plant = make_virtual_plant(PlantSettings(duration_s=duration_s, latency=latency))
    start_ns = plant.deadline_ns
    controller = ControllerNode(controller_preset(preset), start_ns)
    stall = (start_ns + first_ms * MS, start_ns + (first_ms + stall_ms) * MS)
    stalls = {"plant": _NO_STALL, "controller": _NO_STALL, "bus": _NO_STALL, held_up: stall}
    nodes = [HeldUp(plant, stalls["plant"]), HeldUp(controller, stalls["controller"])]
    executor = VirtualTimeExecutor(nodes, HeldUpWire(stalls["bus"]))
    executor.run(start_ns + round((duration_s - 0.1) * 1e9))
    return plant.report(), controller.report()


@given(
    held_up=st.sampled_from(["plant", "controller"]),
    first_ms=st.integers(500, 1500),
    stall_ms=st.integers(1, 3000),
    latency_s=st.sampled_from([0.0, 0.08, 0.25]),
)
@settings(deadline=None, max_examples=8)
def test_a_process_that_was_held_up_however_long_costs_no_frame(
    held_up: str, first_ms: int, stall_ms: int, latency_s: float
) -> None:
    plant, controller = reports_of(held_up, first_ms, stall_ms, latency_s)
    assert (plant["rejected"], controller["rejected"]) == ({}, {})


@pytest.mark.parametrize(
    ("preset", "stall_ms", "refused"),
    [
        ("practical_pd", 100, 0),
        ("practical_pd", 300, 15),
        ("paper_pd", 50, 141),
        ("paper_pd", 150, 115),
    ],
)
def test_a_bus_that_was_held_up_costs_what_did_not_fit_and_150_ms_at_most(
    preset: str, stall_ms: int, refused: int
) -> None:
    """What waited in a buffer comes late; where frames were lost meanwhile, the counter restarts.

    ``paper_pd`` runs at 1 kHz, so that its buffer is full after 12 ms.
    """
    plant, controller = reports_of("bus", 1000, stall_ms, preset=preset, duration_s=2.0)
    assert (sum(plant["rejected"].values()), controller["rejected"]) == (refused, {})
    assert plant["safety"]["fallbacks"] == 0
    assert plant["safety"]["longest_silence_s"] < 1e-3 * stall_ms + 0.17
