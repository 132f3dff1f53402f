"""Runs of plant emulator and controller together from Python; the result is arrays.

>>> import steer_by_wire
>>> run = steer_by_wire.simulate(duration_s=5.0, overrides={"plant.latency.downlink.mean_s": 0.08})
>>> run.plant.lateral_error_m.shape
(500,)
>>> f"{1e3 * run.rms_m:.1f} mm"
'46.7 mm'
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np

from ...controller.law_interface import Law
from ...controller.settings import PRESETS as CONTROLLER_PRESETS
from ...controller.settings import ControllerSettings
from ...controller.settings import shared_vehicle as nominal_vehicle
from ...hand_wheel.node import HandWheelNode
from ...hand_wheel.settings import PRESETS as HAND_WHEEL_PRESETS
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.shaking import shaking_report
from ...plant_emulator.node.settings_without_effect import never_varies
from ...plant_emulator.settings import PRESETS as PLANT_PRESETS
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.settings import shared_vehicle as plant_vehicle
from ...runtime.array_types import FloatArray
from ...runtime.bus_model.settings import BusSettings
from ...runtime.command_line import installation
from ...runtime.node import NS_PER_S
from ...runtime.settings import (
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    preset_names,
    read_preset,
    with_values,
)
from ...runtime.settings.plugin import by_place
from ..pair.agreed_period import pair_warnings, with_period_of
from ..pair.with_hand_wheel import with_hand_wheel
from .simulated_run import ControllerTable, HandWheelTable, PlantTable, Run

Engine = Literal["virtual", "compiled"]
NO_OVERRIDES: Mapping[str, Any] = {}

_SIDES: Mapping[type[Settings], tuple[str, str, Callable[[Path], SharedTable | None]]] = {
    PlantSettings: ("plant", PLANT_PRESETS, plant_vehicle),
    ControllerSettings: ("controller", CONTROLLER_PRESETS, nominal_vehicle),
    HandWheelSettings: ("hand_wheel", HAND_WHEEL_PRESETS, lambda _file: None),
}
"""Name of each side's settings, package with its presets, and its table in a vehicle's file."""

_DOWNLINK = "plant.latency.downlink"
SHORT: Mapping[str, str] = {
    "seed": "plant.seed",
    "duration_s": "plant.duration_s",
    "law": "controller.law",
    "latency_s": f"{_DOWNLINK}.mean_s",
    "jitter_s": f"{_DOWNLINK}.spread_s",
    "loss": f"{_DOWNLINK}.loss",
    "latencies": f"{_DOWNLINK}.latencies_s",
}
"""Settings that have a name of their own in Python."""
GAMMA: Mapping[str, str] = {f"{_DOWNLINK}.model": "gamma"}
"""What ``jitter_s`` sets with its key."""

S = TypeVar("S", bound=Settings)


def plant_presets() -> list[str]:
    """Return the names of the plants that are shipped.

    >>> "paper_nominal" in plant_presets()
    True
    """
    return preset_names(PLANT_PRESETS)


def controller_presets() -> list[str]:
    """Return the names of the controllers that are shipped.

    >>> "practical_predictor" in controller_presets()
    True
    """
    return preset_names(CONTROLLER_PRESETS)


def simulate(
    plant: str | Path | PlantSettings = "paper_nominal",
    controller: str | Path | ControllerSettings = "practical_pd_ddob",
    *,
    hand_wheel: str | Path | HandWheelSettings | None = None,
    vehicle: str | Path | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
    law: str | Law | None = None,
    latency_s: float | None = None,
    jitter_s: float | None = None,
    loss: float | None = None,
    latencies: Sequence[float] | FloatArray | None = None,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    engine: Engine = "virtual",
    bus: str | Path | Mapping[str, Any] | BusSettings | None = None,
) -> Run:
    """Run both programs' nodes to the end of the motion.

    ``plant``, ``controller``  name of a preset, settings file (a path, or a text that ends with
                               .toml), or settings
    ``hand_wheel``    as these two: adds a hand wheel with its driver
    ``vehicle``       file whose [vehicle] both take, as ``design`` reads it, and the plant [car]
    ``seed``, ``duration_s``   of the plant; None keeps what its settings say
    ``law``           of the controller; None keeps what its settings say
    ``latency_s``, ``jitter_s``, ``loss``   of the commands: mean latency, standard deviation of a
                      gamma distribution, share of lost frames, 0 to 1; None keeps them
    ``latencies``     of the commands one by one [s], shape (frames,), in place of the first two;
                      after the last the first again
    ``overrides``     other settings, by ``plant.table.key``, ``controller.`` or ``hand_wheel.``; a
                      part of your own, as a ``VehicleModel``, stands for ``module:ATTRIBUTE``
    ``engine``        virtual: the nodes in virtual time; compiled: the same numbers a hundred times
                      as fast after a first run that compiles, in fewer columns (``Run``)
    ``bus``           between the nodes of a virtual run: settings, a file of them as ``run
                      --bus-settings`` takes it, or values by key, as ``{"load": 0.7}``; None:
                      frames take no time on the wire

    Raises SettingsError, a ValueError, with one line for each mistake, and ValueError where a run
    cannot be computed.

    >>> simulate(overrides={"plant.actuator.lag_s": -1.0})
    Traceback (most recent call last):
    steer_by_wire.runtime.settings.settings.SettingsError: overrides of plant: \
actuator.lag_s = -1.0 should be greater than or equal to 0 (allowed: number from 0.0, up to 10.0)
    """
    own = {
        "seed": seed,
        "duration_s": duration_s,
        "law": law,
        "latency_s": latency_s,
        "jitter_s": jitter_s,
        "loss": loss,
        "latencies": latencies,
    }
    values = by_side(own, overrides, hand_wheel is not None)
    drives = settings_of(ControllerSettings, controller, values["controller"], vehicle)
    driven = settings_of(PlantSettings, plant, values["plant"], vehicle)
    refuse_jitter_around_nothing(jitter_s, driven)
    wire = bus_of(bus, engine)
    warnings = tuple(pair_warnings(driven, drives))
    drives, wheel = with_period_of(driven, drives), None
    if hand_wheel is not None:
        wheel = settings_of(HandWheelSettings, hand_wheel, values["hand_wheel"])
        driven, drives, wheel = with_hand_wheel(driven, drives, wheel)
    if engine == "virtual":
        run = _run_virtual(driven, drives, wheel, wire)
    else:
        run = _run_compiled(driven, drives, wheel)
    return run._replace(pair_warnings=warnings)


def refuse_jitter_around_nothing(jitter_s: float | None, plant: PlantSettings) -> None:
    """Raise SettingsError for a jitter of commands that have no latency."""
    if jitter_s and never_varies(plant.latency.downlink):
        raise SettingsError(f"jitter_s = {jitter_s:g}: needs a latency_s around which it varies")


def by_side(
    own: Mapping[str, Any], overrides: Mapping[str, Any], has_hand_wheel: bool = False
) -> dict[str, dict[str, Any]]:
    """Return values by side, plant, controller and hand wheel; SettingsError for other keys.

    ``own``  by the names in ``SHORT``; None for those that are not given
    """
    named = {SHORT[key]: value for key, value in own.items() if value is not None}
    listed = own.get("latencies")
    if listed is not None and not np.size(listed):
        raise SettingsError("latencies: holds none (allowed: one latency in seconds or more)")
    varied = GAMMA if own.get("jitter_s") else {}
    values: dict[str, dict[str, Any]] = {"plant": {}, "controller": {}}
    if has_hand_wheel:
        values["hand_wheel"] = {}
    for key, value in {**overrides, **named, **varied}.items():
        side, _, name = key.partition(".")
        if side == "hand_wheel" and not has_hand_wheel:
            raise SettingsError(f"overrides: key {key} needs a hand_wheel, as hand_wheel='still'")
        if side not in values or not name:
            known = " nor ".join(f"{each}." for each in values)
            raise SettingsError(f"overrides: key {key} starts with neither {known}")
        values[side][name] = value
    return values


def settings_of(
    model: type[S],
    given: str | Path | S,
    values: Mapping[str, Any],
    vehicle: str | Path | None = None,
    context: Mapping[str, Any] | None = None,
) -> S:
    """Return the settings of one side, plant or controller, as ``simulate`` takes them.

    ``values``  overrides, by ``table.key``; a part stands for its place
    ``vehicle``  file whose vehicle takes the place of that of a preset or file
    ``context`` for validators, as that of ``load_settings``

    Raises SettingsError.
    """
    side, presets, table_of = _SIDES[model]
    shared = None if vehicle is None else table_of(Path(vehicle))
    if isinstance(given, model):
        if shared is not None:
            raise SettingsError(f"vehicle and {side} of type {model.__name__}: give one of the two")
        settings = given
    elif isinstance(given, Path) or (isinstance(given, str) and given.endswith(".toml")):
        settings = load_settings(model, file=Path(given), shared=shared, context=context)
    elif isinstance(given, str):
        settings = load_settings(model, read_preset(presets, given), shared=shared, context=context)
    else:
        raise SettingsError(
            f"{side} is of type {type(given).__name__} (allowed: name of a preset, path of a"
            f" settings file, {model.__name__})"
        )
    where = f"overrides of {side}"
    try:
        placed = by_place(values)
    except ValueError as error:
        raise SettingsError(f"{where}: {error}") from error
    return with_values(settings, placed, where, context) if values else settings


def bus_of(
    given: str | Path | Mapping[str, Any] | BusSettings | None, engine: str
) -> BusSettings | None:
    """Return the bus of a run; raises SettingsError for one that the engine has not."""
    if engine not in get_args(Engine):
        known = ", ".join(get_args(Engine))
        raise SettingsError(f"engine = {engine!r} is not a known one (allowed: {known})")
    if given is not None and engine == "compiled":
        raise SettingsError("bus: in a compiled run frames take no time on the wire")
    if given is None or isinstance(given, BusSettings):
        return given
    if isinstance(given, Mapping):
        return with_values(BusSettings(), given, "bus")
    return load_settings(BusSettings, file=Path(given))


def _run_virtual(
    plant: PlantSettings,
    controller: ControllerSettings,
    hand_wheel: HandWheelSettings | None,
    bus: BusSettings | None,
) -> Run:
    from ...runtime.bus_model.bus_model import BusOverflowError
    from ..pair.virtual_bus import virtual_bus
    from ..pair.virtual_pair import START_S_MAX, make_virtual_pair

    wheel = None
    if hand_wheel is not None:
        cycles_max = plant.duration_ns // hand_wheel.cycle_ns + START_S_MAX * 1000
        wheel = HandWheelNode(hand_wheel, 0, cycles_max)
    # One period more than the motion: the last tick falls on the instant of the last sample.
    pair = make_virtual_pair(
        plant,
        controller,
        plant.duration_ns // plant.sensor_period_ns + 2,
        (plant.duration_ns + START_S_MAX * NS_PER_S) // controller.period_ns + 2,
        hand_wheel=wheel,
    )
    try:
        pair.run(virtual_bus(bus, plant.seed))
    except BusOverflowError as error:
        raise ValueError(f"bus: its bit rate is too low: {error}") from error
    if not pair.has_started:
        raise ValueError(f"no command reached the plant within {START_S_MAX} s of the start")
    motion_ns = pair.plant.motion_start_ns
    plant_report, controller_report = dict(pair.edge.report()), dict(pair.controller.report())
    return Run(
        plant=PlantTable.of_samples(pair.plant.samples),
        controller=ControllerTable.of_samples(pair.controller.samples, motion_ns),
        plant_settings=plant,
        controller_settings=controller,
        plant_report=plant_report,
        controller_report=controller_report,
        engine="virtual",
        outcome=plant_report["failure"] or controller_report["failure"] or "complete",
        hand_wheel=None if wheel is None else HandWheelTable.of_node(wheel, motion_ns),
        hand_wheel_settings=hand_wheel,
        hand_wheel_report=wheel.report() if wheel else {},
    )


def _run_compiled(
    plant: PlantSettings, controller: ControllerSettings, hand_wheel: HandWheelSettings | None
) -> Run:
    try:
        from ..compiled.engine import run_compiled
        from ..compiled.hand_wheel import shaking_of
    except ImportError as error:
        raise ValueError(
            f"engine = 'compiled' needs {error.name}: {installation(str(error.name))}"
        ) from error

    run = run_compiled(plant, controller, hand_wheel=hand_wheel)
    return Run(
        plant=PlantTable.of_compiled(run),
        controller=ControllerTable.of_compiled(run),
        plant_settings=plant,
        controller_settings=controller,
        plant_report={},
        controller_report={},
        engine="compiled",
        outcome=str(run.outcome),
        hand_wheel=HandWheelTable.of_compiled(run),
        hand_wheel_settings=hand_wheel,
        hand_wheel_report=shaking_report(shaking_of(run.wheel)) if run.wheel else {},
    )
