"""Run of a study: what is missing of a stored one, or a whole one for Python (``run_study``)."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controller.law_interface import Law
from ...controller.settings import ControllerSettings
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.bus_model.settings import BusSettings
from ...runtime.settings import SettingsError, with_values
from ...runtime.settings.plugin import by_place
from ..scripting.simulate import (
    GAMMA,
    NO_OVERRIDES,
    SHORT,
    Engine,
    bus_of,
    by_side,
    refuse_jitter_around_nothing,
    settings_of,
)
from .base_settings import tables_of
from .compiled_runs import Computer
from .result_files import Store, columns_of
from .scenario import Scenarios
from .study import BASE_WHEEL, COLUMNS_TAKEN, WHEEL, Study, load_study, study_of
from .study_file import BaseSettings, StudySettings
from .workers import ShouldStop, Workers

BLOCK_RUNS = 64
"""Compiled runs handed to a worker at once: some tens of milliseconds. One over a bus takes longer
than all of them."""


def run_missing(
    store: Store, workers: Workers, on_progress: Callable[[int], None], should_stop: ShouldStop
) -> bool:
    """Compute and store what is missing; returns whether the study is complete.

    ``on_progress``  called with how many further runs are done

    Computed runs are stored however it ends.
    """
    if store.is_complete:
        return True
    try:
        block_runs = 1 if store.scenarios.study.on_nodes else BLOCK_RUNS
        blocks = (
            ids[first : first + block_runs]
            for ids in store.missing()
            for first in range(0, len(ids), block_runs)
        )
        for computed in workers.compute(blocks, should_stop):
            if len(computed.ids):
                store.put(computed)
                on_progress(len(computed.ids))
    finally:
        store.flush()
    if should_stop() and next(store.missing(), None):
        return False
    store.finish()
    return True


def run_study(file: str | Path) -> Mapping[str, NDArray[Any]]:
    """Compute every run of a study file on one thread; returns columns of shape (runs,) by name.

    They are those of ``results.parquet`` of ``steer-by-wire study``, in the same order and the same
    to the last bit. Nothing is stored. Raises SettingsError.
    """
    return _computed(load_study(Path(file)))


def sweep(
    over: Mapping[str, Sequence[Any] | NDArray[Any]],
    *,
    plant: str | Path | PlantSettings = "paper_nominal",
    controller: str | Path | ControllerSettings = "practical_pd_ddob",
    hand_wheel: str | Path | HandWheelSettings | None = None,
    vehicle: str | Path | None = None,
    replicates: int = 1,
    seed: int = 1,
    duration_s: float | None = None,
    law: str | Law | None = None,
    latency_s: float | None = None,
    jitter_s: float | None = None,
    loss: float | None = None,
    latencies: Sequence[float] | FloatArray | None = None,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    engine: Engine | None = None,
    bus: str | Path | Mapping[str, Any] | BusSettings | None = None,
) -> Mapping[str, NDArray[Any]]:
    """Run every combination of values; returns columns of shape (runs,) as ``run_study``.

    ``over``         values by an argument of ``simulate``, as latency_s or controller, or by
                     ``plant.table.key``, ``controller.``, ``hand_wheel.`` or ``bus.``; the last
                     part of the name names the column, or all of it, as plant_duration_s, where
                     that name is taken
    ``replicates``   runs of each combination, each with its own seed from ``seed``
    ``overrides``    other settings, named as in ``over``
    ``engine``       None: compiled, or virtual with a bus

    The other arguments are as for ``simulate``. ``pandas.DataFrame(sweep(...))`` is a frame. Raises
    SettingsError.

    >>> table = sweep({"latency_s": [0.0, 0.1]}, duration_s=5.0)
    >>> [f"{1e3 * rms_m:.1f} mm" for rms_m in table["rms_m"]]
    ['46.4 mm', '46.8 mm']
    """
    if not isinstance(over, Mapping):
        raise SettingsError(f"sweep: takes values by name, as {{'latency_s': [0.1]}}, not {over!r}")
    for key, levels in over.items():
        if isinstance(levels, str) or not isinstance(levels, Iterable):
            raise SettingsError(f"sweep over {key}: takes a list of values, not {levels!r}")
    factors = {key: list(values) for key, values in over.items() if key != "controller"}
    for key in ("plant", "vehicle", "bus"):
        if key in factors:
            raise SettingsError(f"sweep over {key}: takes one; sweep over keys, as {key}.table.key")
    has_bus = bus is not None or any(key.startswith("bus.") for key in factors)
    engine = engine or ("virtual" if has_bus else "compiled")
    wire = bus_of({} if has_bus and bus is None else bus, engine)
    own = {
        "duration_s": duration_s,
        "law": law,
        "latency_s": latency_s,
        "jitter_s": jitter_s,
        "loss": loss,
        "latencies": latencies,
    }
    given = {**own, WHEEL: hand_wheel}
    for key in factors.keys() & {key for key, value in given.items() if value is not None}:
        raise SettingsError(f"sweep over {key}: it is given as an argument too; leave one out")
    varies = "jitter_s" in {*factors, *overrides}
    overrides = {SHORT.get(key, key): value for key, value in overrides.items()}
    if varies:
        overrides |= GAMMA
    wheels = list(over.get(WHEEL, () if hand_wheel is None else [hand_wheel]))
    values = by_side(own, overrides, bool(wheels))
    driven = settings_of(PlantSettings, plant, values["plant"], vehicle)
    refuse_jitter_around_nothing(jitter_s, driven)
    controllers = list(over.get("controller", [controller]))
    names, own_values = _names(controllers), values["controller"]
    driving = [settings_of(ControllerSettings, one, own_values, vehicle) for one in controllers]
    held = [tables_of(settings_of(HandWheelSettings, one, values[WHEEL])) for one in wheels]
    if WHEEL in factors:
        factors[WHEEL] = _names(wheels)
    rows = [
        {"key": SHORT.get(key, key), "name": _column(key, factors), "values": _placed(values)}
        for key, values in factors.items()
    ]
    varied = {"base.controllers": names, "factors": rows}
    varied |= {"sampling": {"replicates": replicates, "seed": seed}, "verdict": driven.verdict}
    settings = with_values(StudySettings(base=BaseSettings(controllers=("one",))), varied, "sweep")
    study = study_of(
        settings,
        "sweep",
        tables_of(driven),
        dict(zip(names, map(tables_of, driving), strict=True)),
        None if wire is None else tables_of(wire),
        "",
        dict(zip([BASE_WHEEL, *factors.get(WHEEL, ())], [*held[:1], *held], strict=False)),
        on_nodes=engine == "virtual",
    )
    return _computed(study)


def _names(given: Sequence[Any]) -> list[str]:
    """Return a name for each controller or hand wheel: of its preset or file, or law and place."""
    laws = [_law(one) for one in given]
    return [
        law + f" {place}" * (laws.count(law) > 1) if law else str(one)
        for place, (one, law) in enumerate(zip(given, laws, strict=True), start=1)
    ]


def _law(given: Any) -> str:
    """Return the law of settings; empty for a name."""
    if isinstance(given, HandWheelSettings):
        return given.feedback.law
    return str(given.law) if isinstance(given, ControllerSettings) else ""


def _placed(values: Sequence[Any]) -> list[Any]:
    try:
        return list(map(by_place, values))
    except ValueError as error:
        raise SettingsError(f"sweep: {error}") from error


def _column(key: str, over: Iterable[str]) -> str:
    name = key.rpartition(".")[2]
    is_free = name not in COLUMNS_TAKEN and sum(it.rpartition(".")[2] == name for it in over) == 1
    return name if is_free else SHORT.get(key, key).replace(".", "_")


def _computed(study: Study) -> Mapping[str, NDArray[Any]]:
    scenarios = Scenarios(study)
    scenarios.check()
    done = Computer(scenarios).compute(range(study.runs), lambda: False)
    return {name: np.array(values) for name, values in columns_of(scenarios, done).items()}
