"""Program ``steer-by-wire plant``: the plant on a CAN bus, in real time.

steer-by-wire plant --preset paper_nominal -i socketcan -c vcan0 --set latency.downlink.mean_s=0.08
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...dbc.edge import add_edge_arguments, open_edge, read_edge_options, takes_fd
from ...runtime.command_line import output_file, run_main, say
from ...runtime.exit_status import ExitStatus
from ...runtime.node import ReportingNode
from ...runtime.node.end import End
from ...runtime.program.fail_if_conditions import LOOP_QUANTITIES, Ending, add_fail_if_argument
from ...runtime.program.node_options import load_program_settings, make_parser
from ...runtime.program.run_node import run_node
from ...runtime.settings import SettingsError
from ...runtime.settings.toml_text import dump_toml
from ..evaluation.report_in_words import plant_summary, verdict_text
from ..evaluation.run_record import SAMPLES_MAX, write_trace
from ..faults.messages_on_bus import messages_in, naming
from ..faults.stage import with_faults
from ..node.interventions import refuse_with_key
from ..node.node import OF_HAND_WHEEL, RECEIVED, SENT, PlantNode
from ..path.path import curvature
from ..settings import (
    PRESETS,
    PlantSettings,
    plant_motion_params,
    refuse_vehicle,
    shared_vehicle,
)
from ..steering.safety_limiter import AVERAGING_S, Cause
from ..steering.settings import design_guard
from ..vehicle.car.settings import CarSettings
from ..vehicle.car.steady_state import steady_turn
from ..vehicle.moving_vehicle import AnyMotionParams
from ..vehicle.steady_turn import steady_steer_m, understeer_gradient_s2_m, wheelbase_m
from .fail_if_quantities import RUN_QUANTITIES

_POINTS = 4000
"""Points of the path at which the demand is computed."""


def check_text(settings: PlantSettings) -> str:
    """Return the text of ``--check``: a valid settings file, with what follows in comments.

    Raises as the settings do.
    """
    params = plant_motion_params(settings)
    comments = [*_vehicle(settings), "", *_path(settings, params)]
    lines = [f"# {comment}" if comment else "#" for comment in comments]
    return "\n".join([dump_toml(settings), *lines, ""])


def _vehicle(settings: PlantSettings) -> Iterator[str]:
    vehicle = settings.vehicle
    model = vehicle.model if settings.car is None else settings.car.model
    if model is not None:
        yield f"Vehicle: equations of another package ({model}), which are not analysed."
        return
    length_m = wheelbase_m(vehicle)
    gradient = understeer_gradient_s2_m(vehicle)
    yield f"Vehicle: {vehicle.speed_m_s:.4g} m/s ({3.6 * vehicle.speed_m_s:.4g} km/h):"
    yield f"  wheelbase            {length_m:.4g} m"
    yield f"  understeer gradient  {gradient:.4g} rad per m/s²"
    if gradient < 0.0:
        critical_m_s = math.sqrt(-length_m / gradient)
        verdict = "above it: UNSTABLE" if critical_m_s <= vehicle.speed_m_s else "below it: stable"
        yield f"  critical speed       {critical_m_s:.4g} m/s, {verdict}"
    else:
        yield "  critical speed       none: it does not oversteer"


def _path(settings: PlantSettings, params: AnyMotionParams) -> Iterator[str]:
    vehicle, path = settings.vehicle, params.path
    speed_m_s = vehicle.speed_m_s
    driven_m = speed_m_s * settings.duration_s
    lap = f"a lap of {path.length_m:.4g} m" if path.closed else f"{path.length_m:.4g} m long"
    yield f"Path: {settings.path.kind}, {lap}; {driven_m:.4g} m in {settings.duration_s:g} s:"
    within_m = min(driven_m, path.length_m or driven_m) or driven_m
    places_m = np.linspace(0.0, within_m, _POINTS).tolist()
    curvature_1_m = np.array([curvature(path, place_m) for place_m in places_m])
    largest_1_m = float(np.abs(curvature_1_m).max())
    yield f"  largest curvature    {largest_1_m:.4g} 1/m"
    yield f"  lateral acceleration {speed_m_s**2 * largest_1_m:.4g} m/s²"
    if settings.car is not None:
        yield _grip(settings, settings.car, largest_1_m)
    # From the critical speed on it is not positive.
    steer_m = steady_steer_m(vehicle)
    if vehicle.model is not None or steer_m <= 0.0:
        return
    steer = steer_m * curvature_1_m
    window = max(1, min(_POINTS - 1, round(AVERAGING_S * speed_m_s / within_m * _POINTS)))
    windows = np.lib.stride_tricks.sliding_window_view(steer, window + 1)
    sweep_rad = float(np.ptp(windows, axis=1).max())
    reach_rad = float(np.abs(steer).max())
    within = f" within {AVERAGING_S:g} s"
    yield f"  steer to follow it   {reach_rad:.4g} rad, {sweep_rad:.4g} rad{within}"
    guard = design_guard(settings.safety, vehicle, settings.actuator)
    for row in guard.limiter.table.rows:
        for needed_rad, allowed_rad, when in (
            (reach_rad, row.reach_rad, ""),
            (sweep_rad, row.sweep_rad, within),
        ):
            if math.isfinite(allowed_rad):
                name = Cause(row.cause).name.lower()
                verdict = "" if needed_rad <= allowed_rad else "  TOO LITTLE for this path"
                yield f"  limit {name:21} {allowed_rad:.4g} rad{when}{verdict}"
    stop_rad = settings.actuator.angle_limit_rad
    if stop_rad is not None and stop_rad < reach_rad:
        yield f"  actuator angle limit {stop_rad:.4g} rad  TOO LITTLE for this path"


def _grip(settings: PlantSettings, car: CarSettings, curvature_1_m: float) -> str:
    """Return how much of its grip a car needs for the sharpest bend, and what it is there."""
    speed_m_s = settings.vehicle.speed_m_s
    try:
        turn = steady_turn(settings.vehicle, car, speed_m_s, curvature_1_m)
    except ValueError as error:
        return f"  grip                 {error}"
    return (
        f"  grip used there      {100.0 * turn.grip_share:.0f} %, cornering stiffness"
        f" {turn.vehicle.front_cornering_stiffness_n_rad:.4g} and"
        f" {turn.vehicle.rear_cornering_stiffness_n_rad:.4g} N/rad"
    )


NAME = "steer-by-wire plant"
ENDING = Ending({**RUN_QUANTITIES, **LOOP_QUANTITIES}, lambda report: verdict_text(report["node"]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(
        NAME,
        "Emulate vehicle, path, actuator and network latency on a CAN bus.",
        f"{NAME} --preset paper_nominal --seed 7 --set latency.downlink.mean_s=0.08",
        PRESETS,
        PlantSettings,
    )
    parser.add_argument(
        "--vehicle", type=Path, metavar="VEHICLE.toml", help="take [vehicle], [car] from a file"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    parser.add_argument(
        "--interventions",
        action="store_true",
        help="accept LATENCY_CONFIG and DISTURBANCE_CONFIG from anyone on the bus",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="do not run; print settings, and figures of vehicle, path and limits",
    )
    parser.add_argument("--trace", type=output_file, metavar="FILE", help="write every sample, CSV")
    add_fail_if_argument(parser, ENDING.quantities)
    add_edge_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    overrides = [] if options.seed is None else [f"seed={options.seed}"]
    overrides += ["interventions=allow"] if options.interventions else []
    language = read_edge_options(options)
    refuse_vehicle(options.settings)
    settings = load_program_settings(
        PlantSettings,
        PRESETS,
        options,
        overrides,
        shared_vehicle(options.vehicle),
        naming(language),
    )
    refuse_with_key(settings, options.key_file is not None)
    if options.check:
        print(check_text(settings), end="")
        return ExitStatus.OK
    if settings.path_ahead is not None and not (options.dialect or takes_fd(options)):
        raise SettingsError(
            "[path_ahead]: PATH_AHEAD needs CAN FD: add --fd to both programs, or omit the table"
        )
    params = plant_motion_params(settings)
    # Without a trace nothing reads the samples.
    samples_max = 0 if options.trace is None else SAMPLES_MAX

    def make_node(start_ns: int) -> ReportingNode:
        node = PlantNode(settings, start_ns, params, samples_max)
        spoken = language.at_edge(node, End.PLANT, start_ns)
        return with_faults(spoken, settings.faults, settings.seed, messages_in(language))

    conclude = partial(_conclude, options)
    of_hand_wheel = OF_HAND_WHEEL if settings.hand_wheel else ()
    edge = open_edge(End.PLANT, (*RECEIVED, *of_hand_wheel, *SENT), options, language)
    return run_node(NAME, options, settings, make_node, conclude, edge, ENDING)


def _conclude(options: argparse.Namespace, node: PlantNode) -> None:
    if options.trace is not None:
        write_trace(options.trace, node.path, node.samples)
    for heading, text in plant_summary(node.report()):
        say(NAME, f"{heading} {text}")
