"""Times laws, frames, the controller node, the loop in virtual time and lockstep, and starts."""

import argparse
import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.comparison import comparison_text, ratios_of, read_ratios
from benchmarks.lockstep import lockstep_lines, missing_tools
from benchmarks.measurement import Line, Measured, Target, calibration, line_record, timed
from benchmarks.starts import heavy_modules, startup_lines
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws import LAWS
from steer_by_wire.controller.laws.law_from_settings import LawDesign, design_law
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import PRESETS, controller_preset
from steer_by_wire.dbc import messages
from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.messages import decode, encode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.settings import preset_names

STEPS = 10_000
JUDGED_LAW = "pd_ddob"
CONTROL_STEP_TARGET_US = 5.0
SPEED_TARGET = 200.0
MOTION_S = 20.0
VIRTUAL_REPETITIONS = 5
PERIOD_NS = 10_000_000

MESSAGES: tuple[messages.Message, ...] = (
    messages.SteeringCommand(0.01234, 4321, messages.Mode.ACTIVE),
    messages.LateralError(0.01234, -0.002),
    messages.SteeringStatus(0.01234, 4321, messages.SteeringStatusCode.APPLYING),
    messages.VehicleState(1.39, 0.012, 0.033),
    messages.ControllerStatus(messages.Mode.ACTIVE, messages.LawNumber.PD_DDOB, 0.012, -0.034, 5),
    messages.PlantStatus(0.08, 0.02, 7, 0),
    messages.LatencyConfig(messages.Direction.BOTH, messages.LatencyModel.NORMAL, 0.08, 0.03, 0.01),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument(
        "--against", type=Path, metavar="SAVED", help="list what is slower than in a saved file"
    )


def measure(options: argparse.Namespace) -> Measured:
    """Time everything; the ratios to a fixed loop of arithmetic compare between machines."""
    before = None if options.against is None else read_ratios(options.against)
    fixed = calibration()
    lines = [
        *law_lines(),
        *frame_lines(),
        controller_node_line(),
        *virtual_time_lines(),
        *startup_lines(),
    ]
    missing = missing_tools()
    lines += [] if missing else lockstep_lines()
    heavy = heavy_modules()
    notes = [
        f"heavy modules {program} imports (target: none): {', '.join(modules) or 'none'}"
        for program, modules in heavy.items()
    ]
    if missing:
        notes.append(f"lockstep was not measured: this machine has no {', '.join(missing)}")
    if before is not None:
        now = ratios_of([line_record(line, fixed.median) for line in lines])
        notes.append(comparison_text(before, now))
    return Measured([fixed, *lines], notes, {"heavy_modules": heavy}, fixed.median)


def law_lines() -> list[Line]:
    """Time one control step of each law."""
    errors_m = [0.01 * math.sin(0.01 * step) for step in range(STEPS)]
    return [
        timed(
            f"control step {law}",
            partial(_control_often, design_law(controller_preset(f"practical_{law}")), errors_m),
            STEPS,
            CONTROL_STEP_TARGET_US if law == JUDGED_LAW else None,
        )
        for law in LAWS
        if f"practical_{law}" in preset_names(PRESETS)
    ]


def frame_lines() -> list[Line]:
    """Time encoding and decoding of each message."""
    lines = []
    for message in MESSAGES:
        name, frame = type(message).__name__, encode(message, 7)
        lines.append(timed(f"encode {name}", partial(_encode_often, message), STEPS))
        lines.append(timed(f"decode {name}", partial(_decode_often, frame), STEPS))
    return lines


def controller_node_line() -> Line:
    """Time a LATERAL_ERROR frame in, a tick, and its STEERING_COMMAND frame out, with pd_ddob."""
    node = ControllerNode(controller_preset(f"practical_{JUDGED_LAW}"), 0)
    frames = [
        encode(messages.LateralError(0.01 * math.sin(0.1 * counter), 0.0), counter)
        for counter in range(COUNTERS)
    ]
    return timed("controller node, in to out", partial(_answer_often, node, frames), STEPS)


def virtual_time_lines() -> list[Line]:
    """Measure how many times as fast as real time both nodes run, with pd_ddob at 100 Hz.

    The ratio is that of the time of one control period.
    """
    wires = {
        "ideal wire": None,
        f"{QUIET_BUS.bitrate_bit_s // 1000} kbit/s": QUIET_BUS.bitrate_bit_s,
    }
    return [_virtual_time_line(name, rate_bit_s) for name, rate_bit_s in wires.items()]


def _virtual_time_line(wire: str, bitrate_bit_s: int | None) -> Line:
    factors, work_us = [], []
    for _ in range(VIRTUAL_REPETITIONS):
        pair = make_virtual_pair(
            PlantSettings(duration_s=MOTION_S), controller_preset(f"practical_{JUDGED_LAW}")
        )
        bus = None if bitrate_bit_s is None else QuietBus(bitrate_bit_s)
        begin_s = time.perf_counter()
        run_virtual_nodes(pair.edge, pair.controller, bus, None, lambda: False)
        elapsed_s = time.perf_counter() - begin_s
        factors.append(MOTION_S / elapsed_s)
        work_us.append(1e6 * elapsed_s / MOTION_S * PERIOD_NS * 1e-9)
    target = Target(at_most=False, value=SPEED_TARGET)
    return Line(f"virtual time, {wire}", "x", factors, work_us, target)


def _control_often(design: LawDesign, errors_m: Sequence[float]) -> None:
    params, step, state = design.params, design.step, design.initial_state(0.0)
    steer_rad = 0.0
    for error_m in errors_m:
        state, output = step(params, state, LawInput(error_m, steer_rad))
        steer_rad = output.steer_rad


def _encode_often(message: messages.Message) -> None:
    for index in range(STEPS):
        encode(message, index % COUNTERS)


def _decode_often(frame: Frame) -> None:
    for _ in range(STEPS):
        decode(frame)


def _answer_often(node: ControllerNode, frames: Sequence[Frame]) -> None:
    for _ in range(STEPS):
        now_ns = node.deadline_ns
        node.on_frame(frames[now_ns // PERIOD_NS % COUNTERS], now_ns)
        node.on_tick(now_ns)
