"""Run plant emulator and controller in one process, in virtual time.

    steer-by-wire run --preset practical_pd --out out/run
    steer-by-wire run plant.toml --controller controller.toml
    steer-by-wire run --controller-command './my_controller --gain 2'

The same settings and seed give the same run, to the last bit, on every machine. With
``--controller-command`` another program is the controller; it speaks the lockstep protocol on its
standard input and output. With ``--out DIR`` it leaves there settings, reports, the plant's trace
and every frame, and prints the command that makes the run again. The exit status is 5 where a
program has failed, 6 where a condition of --fail-if is met. The last line is the verdict.
"""

import argparse
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.closed_loop.pair.agreed_period import pair_warnings, with_period_of
from steer_by_wire.closed_loop.pair.pair_result import (
    BUS,
    CONTROLLER_PROGRAM,
    HAND_WHEEL_PROGRAM,
    PLANT_PROGRAM,
    PairFiles,
)
from steer_by_wire.closed_loop.pair.with_hand_wheel import with_hand_wheel
from steer_by_wire.controller.laws import LAWS
from steer_by_wire.controller.settings import PRESETS as CONTROLLER_PRESETS
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.controller.settings import shared_vehicle as controller_vehicle
from steer_by_wire.dbc.bus_language import BusLanguage
from steer_by_wire.dbc.edge import add_edge_arguments, read_edge_options
from steer_by_wire.dbc.secoc.key_file import read_key
from steer_by_wire.hand_wheel.program import QUANTITIES as OF_HAND_WHEEL
from steer_by_wire.hand_wheel.program import write_hand_wheel_trace
from steer_by_wire.hand_wheel.settings import PRESETS as HAND_WHEEL_PRESETS
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.plant_emulator.evaluation.run_record import write_trace
from steer_by_wire.plant_emulator.faults.messages_on_bus import naming
from steer_by_wire.plant_emulator.node.interventions import refuse_with_key
from steer_by_wire.plant_emulator.settings import PRESETS as PLANT_PRESETS
from steer_by_wire.plant_emulator.settings import PlantSettings, refuse_vehicle
from steer_by_wire.plant_emulator.settings import shared_vehicle as plant_vehicle
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.command_line import (
    add_json_argument,
    add_out_argument,
    command_parser,
    offer,
    run_main,
    say,
    seconds,
    shell_words,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.bus_options import (
    add_error_argument,
    add_traffic_arguments,
    bit_rate,
    bus_settings,
)
from steer_by_wire.runtime.program.fail_if_conditions import add_fail_if_argument, fail_status
from steer_by_wire.runtime.program.node_options import settings_file
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import show_or_write, write_json
from steer_by_wire.runtime.settings import (
    Preset,
    Settings,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)
from steer_by_wire.runtime.settings.mistakes import hint, setting_words
from steer_by_wire.tools.run.result import (
    CONTROLLER_PREFIX,
    NAME,
    QUANTITIES,
    reports_of,
    run_in_virtual_time,
    summary,
    verdict,
)

PLANT_SIDE, CONTROLLER_SIDE, HAND_WHEEL_SIDE = "plant", "controller", "hand_wheel"
_PACKAGES: Mapping[str, str] = {PLANT_SIDE: PLANT_PRESETS, CONTROLLER_SIDE: CONTROLLER_PRESETS}
_MODELS: Mapping[str, type[Settings]] = {
    PLANT_SIDE: PlantSettings,
    CONTROLLER_SIDE: ControllerSettings,
    HAND_WHEEL_SIDE: HandWheelSettings,
}


def add_side_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add both options, whose values are pairs of a side and a text.

    ``default``  the controller's preset, for the help
    """
    preset = parser.add_argument(
        "--preset", type=_preset, action="append", default=[], metavar="NAME",
        help=f"preset of plant or controller, one each (default: {default}): {', '.join(_names())}",
    )  # fmt: skip
    offer(preset, _names)
    override = parser.add_argument(
        "--set", type=_override, dest="overrides", action="append", default=[],
        metavar="SIDE.KEY=VALUE",
        help="override one setting, such as plant.seed=3; repeatable",
    )  # fmt: skip
    offer(
        override,
        lambda: [f"{s}.{word}" for s, model in _MODELS.items() for word in setting_words(model)],
    )


def of_side(given: Sequence[tuple[str, str]], side: str) -> list[str]:
    """Return what was given for one side."""
    return [text for whose, text in given if whose == side]


def _preset_of(options: argparse.Namespace, side: str, default: str | None = None) -> Preset | None:
    """Return the preset of one side, if any; raises SettingsError for two."""
    names = of_side(options.preset, side)
    if len(names) > 1:
        raise SettingsError(f"--preset: {' and '.join(names)} are both of the {side}")
    name = names[0] if names else default
    return read_preset(_PACKAGES[side], name) if name else None


def _names() -> list[str]:
    return [name for package in _PACKAGES.values() for name in preset_names(package)]


def _preset(name: str) -> tuple[str, str]:
    for side, package in _PACKAGES.items():
        if name in preset_names(package):
            return side, name
    raise argparse.ArgumentTypeError(f"no preset {name[:60]!r} ({hint(name, _names())})")


def _override(text: str) -> tuple[str, str]:
    side, _, rest = text.partition(".")
    if side in _MODELS and rest:
        return side, rest
    first = re.split("[.=]", text)[0]
    owners = [name for name, model in _MODELS.items() if first in model.model_fields]
    meant = f" (did you mean {owners[0]}.{text[:60]}?)" if owners else ""
    raise argparse.ArgumentTypeError(
        f"{text[:60]!r} begins with none of plant., controller. and hand_wheel.{meant}"
    )


CONTROLLER_PRESET = "practical_pd_ddob"
"""The controller's settings unless others are given."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = f"{NAME} --set plant.latency.downlink.mean_s=0.08 --out out/run"
    parser = command_parser(NAME, __doc__, example, "[PLANT.toml] [options]")
    parser.add_argument(
        "plant", nargs="?", type=Path, metavar="PLANT.toml", help="settings of the plant"
    )
    parser.add_argument(
        "--controller", type=Path, metavar="CONTROLLER.toml", help="settings of the controller"
    )
    add_side_arguments(parser, CONTROLLER_PRESET)
    parser.add_argument(
        "--vehicle", type=Path, metavar="VEHICLE.toml",
        help="take the vehicle of plant and controller from [vehicle] and [car] of a file",
    )  # fmt: skip
    parser.add_argument(
        "--duration", type=seconds, metavar="SECONDS", help="duration of the motion"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    law = parser.add_argument(
        "--law", metavar="NAME", help="short for --set controller.law=NAME; also package.module:LAW"
    )
    offer(law, lambda: LAWS)
    parser.add_argument(
        "--controller-command", type=shell_words, metavar="WORDS",
        help="run this program as the controller, in lockstep with virtual time",
    )  # fmt: skip
    parser.add_argument(
        "--hand-wheel", type=settings_file(HAND_WHEEL_PRESETS), metavar="FILE",
        help="add a hand wheel with its driver: a settings file or a preset, as still or hands_off",
    )  # fmt: skip
    add_edge_arguments(parser)
    bus = parser.add_mutually_exclusive_group()
    bus.add_argument(
        "--bitrate", type=bit_rate, metavar="BIT/S",
        help="bit rate of the bus (default: 500000)",
    )  # fmt: skip
    bus.add_argument("--ideal-wire", action="store_true", help="frames take no time on the bus")
    add_traffic_arguments(parser)
    add_error_argument(parser)
    add_out_argument(parser, None, "folder for the run's files")
    add_json_argument(parser)
    add_fail_if_argument(parser, QUANTITIES)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    language = read_edge_options(options)
    plant_settings, controller = _plant_settings(options, language), _controller(options)
    ours = controller if isinstance(controller, ControllerSettings) else None
    if ours is not None:
        for warning in pair_warnings(plant_settings, ours):
            say(NAME, f"warning: {warning}", sys.stderr)
        controller = ours = with_period_of(plant_settings, ours)
    wheel = _hand_wheel(options)
    for option, given in (("--hand-wheel", wheel), ("--key-file", options.key_file)):
        if given is not None and (ours is None or options.dialect):
            taken = "--controller-command" if ours is None else "--dialect"
            raise SettingsError(f"{option}: a run with {taken} has none; leave out one of the two")
    refuse_with_key(plant_settings, options.key_file is not None)
    if wheel is not None and ours is not None:
        plant_settings, ours, wheel = with_hand_wheel(plant_settings, ours, wheel)
        controller = ours
    compute_mac = options.key_file and read_key(options.key_file)
    bus = _bus_settings(options)
    files = None if options.out is None else PairFiles(options.out)
    if files is not None:
        words = () if ours is not None else options.controller_command
        named = (plant_settings, ours, bus, [*language.files, *map(Path, words)], wheel)
        refuse_another_run(files.folder, files.settings_texts(*named))
        files.write_settings(*named)
    log = files and files.candump_log
    if ours is not None:
        language.refuse_law(ours.law_that_reads_the_vehicle)
    run = run_in_virtual_time(
        plant_settings,
        controller,
        bus,
        log,
        is_ideal=options.ideal_wire,
        language=language,
        hand_wheel=wheel,
        compute_mac=compute_mac,
    )
    reports = reports_of(run, plant_settings, controller, wheel)
    lines = summary(run, reports)
    if wheel is not None:
        from steer_by_wire.closed_loop.scripting.feedback import computed_text  # loads scipy

        lines.append(("feedback", computed_text(plant_settings, wheel)))
    if files is not None:
        for program, report in reports.items():
            write_json(files.report(program), report)
        write_trace(files.plant_trace, run.plant.path, run.plant.samples)
        if run.hand_wheel is not None:
            write_hand_wheel_trace(files.hand_wheel_trace, run.hand_wheel.samples)
        lines += [("files", str(files.folder)), ("again", _command(options, files))]
    status = fail_status(NAME, options.fail_if, QUANTITIES, reports)
    lines.append(("verdict", verdict(reports)))
    width = max(len(heading) for heading, _ in lines)
    shown = "\n".join(f"{heading:{width}}  {text}" for heading, text in lines)
    show_or_write(options.json, reports | {"verdict": verdict(reports)}, partial(print, shown))
    if any(report["node"]["failure"] for report in reports.values()):
        return ExitStatus.SAFE_STATE
    return status


def _plant_settings(options: argparse.Namespace, language: BusLanguage) -> PlantSettings:
    preset = _preset_of(options, PLANT_SIDE)
    short = {"duration_s": options.duration, "seed": options.seed}
    overrides = [f"{key}={value}" for key, value in short.items() if value is not None]
    own = of_side(options.overrides, PLANT_SIDE)
    refuse_vehicle(options.plant)
    return load_settings(
        PlantSettings,
        preset,
        options.plant,
        [*own, *overrides],
        plant_vehicle(options.vehicle),
        naming(language),
        node=PLANT_SIDE,
    )


def _controller(options: argparse.Namespace) -> ControllerSettings | list[str]:
    """Return the settings of our controller, or the words of a command in its place."""
    words: list[str] | None = options.controller_command
    if words is not None:
        _refuse_beside_command(options, words)
        return words
    default = None if options.controller else CONTROLLER_PRESET
    preset = _preset_of(options, CONTROLLER_SIDE, default)
    overrides = of_side(options.overrides, CONTROLLER_SIDE)
    overrides += [] if options.law is None else [f"law={options.law}"]
    vehicle, file, node = controller_vehicle(options.vehicle), options.controller, CONTROLLER_SIDE
    return load_settings(ControllerSettings, preset, file, overrides, vehicle, node=node)


def _hand_wheel(options: argparse.Namespace) -> HandWheelSettings | None:
    own = of_side(options.overrides, HAND_WHEEL_SIDE)
    if options.hand_wheel is None:
        needs_one = [f"--set {HAND_WHEEL_SIDE}.{text}" for text in own]
        needs_one += [f"--fail-if {c.name}" for c in options.fail_if if c.name in OF_HAND_WHEEL]
        if needs_one:
            raise SettingsError(f"{needs_one[0]}: add --hand-wheel too")
        return None
    node = HAND_WHEEL_SIDE.replace("_", " ")
    return load_settings(HandWheelSettings, None, options.hand_wheel, own, node=node)


def _refuse_beside_command(options: argparse.Namespace, words: list[str]) -> None:
    ours = {
        "--controller": options.controller,
        "--preset of the controller": of_side(options.preset, CONTROLLER_SIDE),
        "--set of the controller": of_side(options.overrides, CONTROLLER_SIDE),
        "--law": options.law,
    }
    if given := [option for option, value in ours.items() if value]:
        raise SettingsError(f"--controller-command takes no {given[0]}: the program is its own")
    for condition in options.fail_if:
        if condition.name.startswith(CONTROLLER_PREFIX):
            raise SettingsError(f"--fail-if {condition.name}: another program does not report it")
    if not words:
        raise SettingsError("--controller-command: no program is named")


def _bus_settings(options: argparse.Namespace) -> BusSettings:
    """Return the settings of the bus, refused where this run has none."""
    settings = bus_settings(options)
    if options.ideal_wire and not settings.is_quiet:
        raise SettingsError("--ideal-wire: other traffic and errors need a bus with a bit rate")
    return settings


def _command(options: argparse.Namespace, files: PairFiles) -> str:
    """Return the command that makes a run again from the settings it has left."""
    command = ["steer-by-wire", "run", str(files.settings(PLANT_PROGRAM))]
    if options.controller_command:
        command += ["--controller-command", shlex.join(options.controller_command)]
    else:
        command += ["--controller", str(files.settings(CONTROLLER_PROGRAM))]
    if options.hand_wheel:
        command += ["--hand-wheel", str(files.settings(HAND_WHEEL_PROGRAM))]
    command += ["--ideal-wire"] * options.ideal_wire
    command += ["--key-file", str(options.key_file)] if options.key_file else []
    command += ["--dialect", str(options.dialect)] if options.dialect else []
    command += ["--bus-settings", str(files.settings(BUS))]
    return shlex.join(command)


if __name__ == "__main__":
    sys.exit(main())
