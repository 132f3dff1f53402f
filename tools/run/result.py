"""A run of both nodes, its figures for the user, and what ``--fail-if`` may name of them."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

from ...closed_loop.lockstep.node import LockstepNode, controller_node
from ...closed_loop.pair.pair_result import CONTROLLER_PROGRAM, HAND_WHEEL_PROGRAM, PLANT_PROGRAM
from ...closed_loop.pair.virtual_bus import virtual_bus
from ...closed_loop.pair.virtual_pair import START_S_MAX, pair_with, with_key
from ...controller.command_line import fail_if_quantities as controller_quantities
from ...controller.node import report_in_words as controller_report
from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...dbc.edge import translated_text
from ...dbc.messages import SteeredBy
from ...dbc.secoc.authentication import ComputeMac
from ...hand_wheel.node import STEERED_BY_TEXTS, HandWheelNode
from ...hand_wheel.program import QUANTITIES as HAND_WHEEL_QUANTITIES
from ...hand_wheel.program import SAMPLES_MAX as HAND_WHEEL_SAMPLES_MAX
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.command_line import fail_if_quantities as plant_quantities
from ...plant_emulator.evaluation.report_in_words import plant_summary, verdict_text
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.bus_model import BusModel, BusOverflowError
from ...runtime.bus_model.settings import BusSettings
from ...runtime.exit_status import BusError
from ...runtime.node import ReportingNode
from ...runtime.program.fail_if_conditions import of_part
from ...runtime.program.run_node import FINISHED
from ...runtime.program.stop_request import StopRequest
from ...runtime.settings import Settings

NAME = "steer-by-wire run"
CONTROLLER_PREFIX = "controller_"
"""Of the controller's quantities."""
PROGRAMS = (PLANT_PROGRAM, CONTROLLER_PROGRAM)
QUANTITIES = {
    **of_part(plant_quantities.RUN_QUANTITIES, PLANT_PROGRAM),
    **of_part(controller_quantities.QUANTITIES, CONTROLLER_PROGRAM, CONTROLLER_PREFIX),
    **of_part(HAND_WHEEL_QUANTITIES, HAND_WHEEL_PROGRAM),
}
"""What ``--fail-if`` may name."""


class Run(NamedTuple):
    """One run: its nodes, what carried their frames, what ended it.

    ``edges``      the nodes as they are on the bus: in a dialect, behind faults or authentication
    ``shared``     the bus, where there was other traffic or noise on it
    ``hand_wheel``  None without one
    """

    plant: PlantNode
    controller: ControllerNode | LockstepNode
    edges: Sequence[ReportingNode]
    bus: str
    elapsed_s: float
    ended_by: str
    shared: BusModel | None = None
    hand_wheel: HandWheelNode | None = None


def reports_of(
    run: Run,
    plant: PlantSettings,
    controller: ControllerSettings | Sequence[str],
    hand_wheel: HandWheelSettings | None = None,
) -> dict[str, dict[str, Any]]:
    """Return the report of each program, as the program itself writes it.

    ``controller``  its settings, or the words of its command
    """
    of_program: dict[str, tuple[Settings | Sequence[str], Mapping[str, Any]]] = {
        PLANT_PROGRAM: (plant, run.edges[0].report()),
        CONTROLLER_PROGRAM: (controller, run.edges[1].report()),
    }
    if hand_wheel is not None:
        of_program[HAND_WHEEL_PROGRAM] = hand_wheel, run.edges[2].report()
    return {
        program: {
            "program": NAME,
            "ended_by": run.ended_by,
            "bus": run.bus,
            **(
                {"settings": settings.model_dump(mode="json")}
                if isinstance(settings, Settings)
                else {"command": list(settings)}
            ),
            "node": dict(node),
        }
        for program, (settings, node) in of_program.items()
    }


def summary(run: Run, reports: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return the figures of a run, each with its heading."""
    plant, controller = reports[PLANT_PROGRAM]["node"], reports[CONTROLLER_PROGRAM]["node"]
    lines = [
        ("run", f"{plant['motion_s']:.2f} s of motion in {run.elapsed_s:.2f} s, {run.bus}"),
        ("seed", str(plant["seed"])),
        *(
            _program_summary(controller)
            if isinstance(run.controller, LockstepNode)
            else controller_report.controller_summary(controller)
        ),
        *plant_summary(plant),
    ]
    if HAND_WHEEL_PROGRAM in reports:
        lines.append(("hand wheel", hand_wheel_text(reports[HAND_WHEEL_PROGRAM]["node"])))
    if run.shared is not None:
        lines += _bus_lines(run.shared)
    for program in PROGRAMS:
        if "dialect" not in reports[program]["node"]:
            continue
        text = translated_text(reports[program]["node"]["dialect"])
        lines.append(("dialect", f"{program.replace('_', ' ')}: {text}"))
    if run.ended_by != FINISHED:
        lines.append(("ended", f"by {run.ended_by}, before the plant had finished"))
    return lines


def _failures(reports: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return which programs have failed, each with how: ours are then in their safe state."""
    return [
        f"{'safe state' if 'settings' in reports[program] else 'failed'}: "
        f"{program.replace('_', ' ')}: {failure}"
        for program in reports
        if (failure := reports[program]["node"]["failure"])
    ]


def _program_summary(node: Mapping[str, Any]) -> list[tuple[str, str]]:
    text = f"woken {node['wakes']} times, {node['frames_received']} frames in"
    return [("controller", f"{node['program']}: {text}, {node['frames_sent']} out")]


def verdict(reports: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the plant's verdict, and what limited the commands on their way; or who failed."""
    if failures := _failures(reports):
        return "; ".join(failures)
    is_ours = "settings" in reports[CONTROLLER_PROGRAM]
    limited = controller_report.limited_text(reports[CONTROLLER_PROGRAM]["node"]) if is_ours else ""
    plant = reports[PLANT_PROGRAM]
    wheel = reports.get(HAND_WHEEL_PROGRAM)
    felt = "" if wheel is None else f"hand wheel: {wheel['node']['verdict']}"
    judged = "; ".join(filter(None, (verdict_text(plant["node"]), limited, felt)))
    if not plant["ended_by"].startswith("SIG"):
        return judged
    lasted = f"{plant['node']['motion_s']:.2f} s of {plant['settings']['duration_s']:g} s"
    return f"stopped after {lasted}; until then {judged}"


def _bus_lines(bus: BusModel) -> list[tuple[str, str]]:
    load = bus.load
    lost = f"{load.refused} lost in full transmit buffers"
    lines = [("bus", f"load {100 * load.busy_share:.1f} %, {load.frames} frames, {lost}")]
    if bus.errors is not None:
        text = (
            f"{bus.errors.count or 'none'}; "
            f"{bus.errors.bus_offs} bus-off, {bus.lost_in_bus_off} lost in it"
        )
        lines.append(("bus errors", text))
    return lines


def hand_wheel_text(node: Mapping[str, Any]) -> str:
    """Return how the hand wheel moved, in words."""
    turns = f"up to {node['peak_angle_rad']:.2f} rad and {node['peak_driver_torque_n_m']:.1f} N m"
    who = STEERED_BY_TEXTS[SteeredBy[node["steered_by"].upper()]]
    return f"{node['law']}, {turns} of the driver; at the end {who}"


def run_in_virtual_time(
    plant_settings: PlantSettings,
    controller: ControllerSettings | Sequence[str],
    settings: BusSettings,
    candump_log: Path | None,
    *,
    is_ideal: bool,
    language: BusLanguage = OUR_LANGUAGE,
    hand_wheel: HandWheelSettings | None = None,
    compute_mac: ComputeMac | None = None,
) -> Run:
    """Run plant and controller on a bus with these settings.

    ``controller``  its settings, or the words of a command that speaks the lockstep protocol
    ``is_ideal``    if frames are to take no time
    ``language``    of the bus; a program speaks a car's of itself
    ``hand_wheel``  None: there is none
    ``compute_mac``  of the key with which our nodes authenticate their frames; None: they do not
    """
    wheel = None if hand_wheel is None else HandWheelNode(hand_wheel, 0, HAND_WHEEL_SAMPLES_MAX)
    bitrate = settings.bitrate_bit_s
    bus = virtual_bus(None if is_ideal else settings, plant_settings.seed)
    stop = StopRequest()
    begin_s = time.perf_counter()
    with stop.on_signals(), controller_node(controller) as node:
        pair = pair_with(plant_settings, node, language=language, hand_wheel=wheel)
        if compute_mac is not None:
            pair = with_key(pair, compute_mac, plant_settings.seed)
        try:
            with _progress(plant_settings.duration_s) as on_second:

                def should_stop() -> bool:
                    on_second()
                    return stop()

                pair.run(bus, candump_log, should_stop)
        except BusOverflowError as error:
            raise BusError(f"{bitrate} bit/s are too few: {error}") from error
    elapsed_s = time.perf_counter() - begin_s
    carrier = "a wire that takes no time" if bus is None else f"a bus of {bitrate} bit/s"
    if compute_mac is not None:
        carrier += ", with all nodes authenticated"
    where, ended_by = f"virtual time over {carrier}", stop.reason or FINISHED
    if not (pair.has_started or stop.reason or pair.edge.finished or node.finished):
        ended_by = f"{START_S_MAX} s without a command"
        if isinstance(node, LockstepNode):
            node.failure = node.failure or f"it sent no valid command in {START_S_MAX} s"
    shared = bus if bus is not None and bus.is_lossy else None
    edges = [pair.edge, pair.controller_edge, *filter(None, [pair.hand_wheel])]
    return Run(pair.plant, node, edges, where, elapsed_s, ended_by, shared, wheel)


@contextmanager
def _progress(duration_s: float) -> Iterator[Callable[[], None]]:
    """Show a bar of the seconds, which are reported one by one; without rich there is none."""
    try:
        from rich.console import Console

        from ...closed_loop.reports.terminal import counting_bars
    except ImportError:
        yield lambda: None
        return
    with counting_bars(Console(stderr=True)) as bars:
        yield partial(bars.advance, bars.add_task("", total=ceil(duration_s)))
