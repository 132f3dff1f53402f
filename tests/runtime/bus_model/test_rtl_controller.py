"""Errors of one bit against the RTL of a CAN controller that others wrote: OpenCores, simulated.

    CAN_RTL=FOLDER pytest tests/runtime/bus_model/test_rtl_controller.py

FOLDER holds the public repository freecores/can. Where the two differ, and may:

    TEC   the controller lowers it by one while the bus is idle
    REC   of an error passive receiver falls to 127 at a good frame, the model's to 120
    IDE   read recessive by an error passive sender alone: only nodes for CAN FD take the rest for a
          later standard's format, and count no error; not compared
"""

import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from steer_by_wire.runtime.bus_model.bit_noise import BusNoise, NoiseRates
from steer_by_wire.runtime.bus_model.bit_ticks import bit_ticks
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire

BENCH = Path(__file__).parents[2] / "support" / "three_controllers.v"
REPOSITORY = Path(os.environ.get("CAN_RTL", "no folder")).absolute()
RTL = REPOSITORY / "rtl" / "verilog"
FRAME = Frame(0x123, b"\x55\xa0")
LENGTH = len(frame_on_wire(FRAME))
BITRATE_BIT_S, BIT_NS = 500_000, 2_000
SENDER, RECEIVER, ALL = 0b001, 0b010, 0b111
FIRST_PASSIVE_REC = 128
QUIET = BusNoise(NoiseRates(0.0), BITRATE_BIT_S, 1)


class Case(NamedTuple):
    """Who sees a bit wrong, which one, and the counters of the three nodes before."""

    mask: int
    bit: int
    transmit: tuple[int, int, int] = (0, 0, 0)
    receive: tuple[int, int, int] = (0, 0, 0)


Outcome = tuple[list[int], list[int], list[int | str]]
"""Frames received, rise of TEC, REC of each node."""
POSITIONS = [*range(0, LENGTH - 15, 4), *range(LENGTH - 15, LENGTH)]
CASES = [
    *(Case(mask, index) for mask in (SENDER, RECEIVER, ALL) for index in POSITIONS),
    *(Case(RECEIVER, index, (0, 0, 0), (0, 5, 5)) for index in POSITIONS),
    *(Case(RECEIVER, index, (0, 0, 0), (0, 130, 0)) for index in POSITIONS),
    *(Case(RECEIVER, index, (0, 130, 0), (0, 0, 5)) for index in POSITIONS),
    *(Case(SENDER, index, (140, 0, 0)) for index in POSITIONS),
]


class HitsAt:
    """Noise in the middle of one bit."""

    def __init__(self, index: int) -> None:
        self._hit_ns = index * BIT_NS + BIT_NS // 2

    def first_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        return self._hit_ns if start_ns <= self._hit_ns < end_ns else None


def modelled(case: Case) -> Outcome:
    hit = HitsAt(case.bit)
    alone = {} if case.mask == ALL else {node: hit for node in range(3) if case.mask >> node & 1}
    errors = BusErrors(hit if case.mask == ALL else QUIET, None, alone)
    for node in range(3):
        errors.join(node)
        counters = errors.counters(node)
        counters.transmit, counters.receive = case.transmit[node], case.receive[node]
        errors.note_limits(node)
    ticks = bit_ticks(BITRATE_BIT_S, BITRATE_BIT_S)
    end_ns = LENGTH * BIT_NS
    disturbed = errors.transmission(FRAME, 0, 0, end_ns * ticks.per_ns, ticks)
    received = [0, 1, 1]
    if disturbed is None:
        errors.on_whole(0)
    else:
        errors.on_disturbed(disturbed, 0, FRAME, end_ns)
        received = [
            int(n > 0 and disturbed.is_received and n != disturbed.only_at) for n in range(3)
        ]
    after = [errors.counters(node) for node in range(3)]
    rises = [one.transmit - before for one, before in zip(after, case.transmit, strict=True)]
    return received, rises, [within_the_standard(one.receive) for one in after]


def within_the_standard(receive: int) -> int | str:
    """Say of a REC above what a controller may choose freely only whether it is error passive."""
    return receive if receive < 119 else f"passive: {receive >= FIRST_PASSIVE_REC}"


def simulated(folder: Path) -> list[Outcome]:
    lines = []
    for mask, index, transmit, receive in CASES:
        data = [*FRAME.data, *bytes(8 - len(FRAME.data))]
        counters = [count for pair in zip(transmit, receive, strict=True) for count in pair]
        numbers = [FRAME.can_id, len(FRAME.data), *data, *counters, mask, index, LENGTH]
        lines.append(" ".join(map(str, numbers)))
    (folder / "cases.txt").write_text("\n".join(lines) + "\n")
    sources = sorted(str(one) for one in RTL.glob("can_*.v") if "defines" not in one.name)
    compiler = [
        "iverilog",
        "-g2005",
        "-DCAN_WISHBONE_IF",
        f"-I{RTL}",
        f"-I{REPOSITORY}/bench/verilog",
    ]
    subprocess.run(
        [*compiler, "-o", "bench", str(BENCH), *sources],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    run = subprocess.run(["vvp", "-n", "bench"], cwd=folder, check=True, capture_output=True)
    outcomes: list[Outcome] = []
    for case, line in zip(CASES, run.stdout.decode().splitlines(), strict=True):
        numbers = [int(one) for one in line.split()]
        rises = [
            after - before + (before > 0)
            for after, before in zip(numbers[3:6], case.transmit, strict=True)
        ]
        outcomes.append((numbers[:3], rises, [within_the_standard(one) for one in numbers[6:]]))
    return outcomes


@pytest.mark.skipif(shutil.which("iverilog") is None, reason="iverilog is not installed")
@pytest.mark.skipif(not (RTL / "can_top.v").exists(), reason="CAN_RTL: no controller's RTL there")
def test_a_wrong_bit_has_the_same_consequences_at_a_controller_that_others_wrote(
    tmp_path: Path,
) -> None:
    for case, outcome in zip(CASES, simulated(tmp_path), strict=True):
        assert modelled(case) == outcome, (case, frame_on_wire(FRAME)[case.bit])
