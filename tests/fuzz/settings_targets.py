"""Random settings: TOML files, ``--set``, and the CSV files that settings name.

A mistake raises a SettingsError: one line for each mistake, which begins with where it is.
Accepted settings can be run: the node is made, steps, and sends only what it may send.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.studies.study_file import StudySettings
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import PRESETS as CONTROLLER_PRESETS
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import Message, encode
from steer_by_wire.plant_emulator.network.latency_over_time import read_trace
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.path.waypoints import waypoint_path
from steer_by_wire.plant_emulator.settings import PRESETS as PLANT_PRESETS
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node import NS_PER_MS, Node, ReportingNode
from steer_by_wire.runtime.settings import (
    Settings,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile
from tests.fuzz.node_targets import Outgoing, outgoing_of_controller, outgoing_of_plant
from tests.fuzz.traffic import noise_of, number_of, text_of
from tests.support.frames.made_messages import command_of, error_of

ENTRIES = (0, 0, 0, 1, 1, 6)
"""How many settings a file, or a command line, changes: with many, one is refused."""
MOTION_NS = 300 * NS_PER_MS
STEP_NS = 10 * NS_PER_MS
_EXPONENT_MAX = 40


class Subject(NamedTuple):
    """A kind of settings file, the presets below it, and what runs with it."""

    model: type[Settings]
    preset_package: str | None
    run: Callable[[Any], None]


def fuzz_settings(rng: Random) -> None:
    """Read settings of any kind from a file and from ``--set``, and run what is accepted."""
    subject = rng.choice(subjects())
    leaves = leaves_of(subject.model)
    preset = None
    if subject.preset_package is not None and rng.random() >= 0.1:
        names = preset_names(subject.preset_package)
        preset = read_preset(subject.preset_package, rng.choice(names))
    overrides = _entries(rng, leaves, "=")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "fuzzed.toml"
        if rng.random() < 0.1:
            file.write_bytes(noise_of(rng))
        else:
            text = "\n".join(_entries(rng, leaves, " = "))
            file.write_text(text, encoding="utf-8", errors="replace")
        settings = settled(
            lambda: load_settings(subject.model, preset, file, overrides),
            (str(file), "command line", "preset ", "settings"),
        )
    if settings is not None:
        settled(lambda: subject.run(settings), ("",))


def fuzz_waypoints(rng: Random) -> None:
    """Read waypoints, and follow what path there is."""
    closed = rng.random() < 0.5
    with TemporaryDirectory() as folder:
        file = Path(folder) / "waypoints.csv"
        file.write_bytes(_table(rng, "x_m,y_m"))
        path = settled(lambda: waypoint_path(file, closed=closed), (str(file),))
    if path is None:
        return
    values = [*path.start_m, *path.curvature_1_m, *path.curvature_slope_1_m2, path.length_m]
    assert all(map(math.isfinite, values)), "a path that is not finite"


def fuzz_trace(rng: Random) -> None:
    """Read recorded latencies, and ask for some of them."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "trace.csv"
        file.write_bytes(_table(rng, rng.choice(("latency_s", "time_s,latency_s"))))
        overrides = [f"latency.downlink.trace_file={json.dumps(str(file))}"]
        settings = settled(
            lambda: load_settings(PlantSettings, overrides=overrides), ("command line", "settings")
        )
        if settings is None:
            return
        trace = read_trace(file)
    for frame, time_s in ((0, 0.0), (1, 0.01), (10**9, 1e9)):
        latency_s = trace.latency_s(frame, time_s)
        is_lost = math.isnan(latency_s)
        assert is_lost or 0.0 <= latency_s <= 10.0, f"a latency of {latency_s} s"


def settled(read: Callable[[], Any], begins: Sequence[str]) -> Any:
    """Return what ``read`` returns, None for a SettingsError in the required form."""
    try:
        return read()
    except SettingsError as error:
        mistakes = error.mistakes
    assert mistakes
    for mistake in mistakes:
        assert len(mistake.splitlines()) == 1, f"not one line: {mistake!r}"
        is_placed = mistake.startswith((*begins, "and "))
        assert is_placed, f"does not begin with {begins}: {mistake}"
    return None


@lru_cache
def subjects() -> Sequence[Subject]:
    """Return all kinds of settings."""
    return (
        Subject(ControllerSettings, CONTROLLER_PRESETS, _run_controller),
        Subject(PlantSettings, PLANT_PRESETS, _run_plant),
        Subject(StudySettings, None, lambda _settings: None),
        Subject(VehicleFile, None, lambda settings: settings.box),
        Subject(Specification, None, lambda _settings: None),
    )


@lru_cache
def leaves_of(model: type[Settings]) -> Sequence[str]:
    """Return the dotted keys of a model, those of every member of a union included."""
    schema = model.model_json_schema()
    return sorted(set(_leaves(schema, schema, "")))


def _leaves(root: Mapping[str, Any], schema: Mapping[str, Any], prefix: str) -> Iterator[str]:
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    for member in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        yield from _leaves(root, member, prefix)
    for key, child in schema.get("properties", {}).items():
        dotted = f"{prefix}.{key}".removeprefix(".")
        yield dotted
        yield from _leaves(root, child, dotted)


def _entries(rng: Random, leaves: Sequence[str], equals: str) -> list[str]:
    entries = []
    for _ in range(rng.choice(ENTRIES)):
        key = text_of(rng, 12) if rng.random() < 0.06 else rng.choice(leaves)
        entries.append(f"{key}{equals}{toml_value(rng)}")
    return entries


def toml_value(rng: Random) -> str:
    """Return a value in TOML's syntax, or something similar."""
    kind = rng.randint(0, 11)
    if kind < 4:
        return repr(number_of(rng))
    if kind < 6:
        return f"1e{rng.randint(-_EXPONENT_MAX, _EXPONENT_MAX)}"
    if kind == 6:
        return str(rng.randint(-(2**70), 2**70))
    if kind == 7:
        return json.dumps(rng.choice(_WORDS))
    if kind == 8:
        return rng.choice(("true", "false", "1979-05-27", "07:32:00", "{}", "[]", "[[]]", '""'))
    if kind == 9:
        return f"[{', '.join(toml_value(rng) for _ in range(rng.randint(0, 3)))}]"
    if kind == 10:
        return f"{{ {text_of(rng, 5)} = {rng.randint(0, 9)} }}"
    return text_of(rng)


_WORDS = (
    "pd", "pd_dob", "pd_cdob", "pd_ddob", "vehicle", "paper_eq19", "order_2", "type_2", "straight",
    "circle", "ellipse", "single_lane_change", "double_lane_change", "waypoints", "uniform",
    "normal", "lognormal", "gamma", "in_order", "as_arrives", "ramp", "step", "grid", "sobol",
    "log_uniform", "/dev/null", "..", "\x1b[2J", "a\nb", "\x00",
)  # fmt: skip


def _table(rng: Random, header: str) -> bytes:
    """Return rows of ordinary numbers, in which some, or all, are odd ones, or noise."""
    if rng.random() < 0.2:
        return noise_of(rng)
    columns, odd, lines = header.count(",") + 1, rng.choice((0.0, 0.02, 1.0)), [header]
    for row in range(rng.randint(0, 12)):
        ordinary = [float(row), rng.uniform(0.0, 0.02)][-columns:]
        cells = [number_of(rng) if rng.random() < odd else it for it in ordinary]
        lines.append(",".join(f"{cell:.17g}" for cell in cells))
    if rng.random() < 0.1:
        lines.append(text_of(rng))
    return "\n".join(lines).encode("utf-8", errors="surrogateescape")


def _run_controller(settings: ControllerSettings) -> None:
    errors = [error_of(error_m) for error_m in (0.0, 1e-3, 80.0, -80.0, 0.5)]
    _run(ControllerNode(settings, 0), errors, outgoing_of_controller(settings))


def _run_plant(settings: PlantSettings) -> None:
    steers_rad = (0.0, 0.01, 1.3, -1.3, 0.0)
    commands = [command_of(rad, place) for place, rad in enumerate(steers_rad)]
    _run(PlantNode(settings, 0), commands, outgoing_of_plant())


def _run(node: ReportingNode, messages: Sequence[Message], outgoing: Outgoing) -> None:
    for number, message in enumerate(messages):
        node.on_frame(encode(message, number), number * STEP_NS)
        outgoing.look(_ticks(node, number * STEP_NS))
    outgoing.look(_ticks(node, MOTION_NS))
    json.dumps(node.report())


def _ticks(node: Node, now_ns: int) -> list[Any]:
    return [*node.on_tick(now_ns)] if node.deadline_ns <= now_ns else []
