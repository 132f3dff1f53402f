"""The same results to the last bit, whichever instructions the libraries choose for a processor.

OpenBLAS and numpy look at the processor and take what is fastest there, which adds in different
orders and rounds differently. Made to behave as on the oldest, they must make no difference to what
they do on this one, nor (``--hypothesis-profile=explore``) made to behave as on others.

Compared are designs, tables, paths, a run of every law and a study, each as small as shows a
difference in the last bit. As a program it prints their digests by name, in JSON.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.compilation import compiled
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.closed_loop.studies.workers import thread_workers
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import (
    CircleSettings,
    DoubleLaneChangeSettings,
    EllipseSettings,
    SingleLaneChangeSettings,
    WaypointSettings,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.motion_parameters import design_motion_arrays
from steer_by_wire.runtime.settings import load_settings, preset_names, read_preset
from tests.support.suite.combinations import sampled

ROOT = Path(__file__).resolve().parents[3]
CONTROLLERS, PLANTS = "steer_by_wire.controller.presets", "steer_by_wire.plant_emulator.presets"
SPEEDS_M_S = (0.7, 1.4, 9.0, 30.0)
RUN = """
duration_s = 1.0
sensor_noise = {{ lateral_error_m = 0.005 }}
path = {{ kind = "circle", radius_m = 30.0 }}
disturbance.steps = [{{ at_s = 0.3, steering_offset_rad = 0.02 }}]
actuator = {{ lag_s = 0.1 }}
[latency.downlink]
model = "{down}"
mean_s = 0.03
spread_s = 0.02
correlation_time_s = 0.1
loss = 0.02
[latency.uplink]
model = "{up}"
mean_s = 0.01
spread_s = 0.005
loss = 0.02
"""
JITTERS = tuple(model.value for model in Distribution if model is not Distribution.CONSTANT)


def digest(value: Any) -> str:
    data = value if isinstance(value, bytes) else repr(value).encode()
    return hashlib.sha256(data).hexdigest()[:16]


def controllers() -> dict[str, ControllerSettings]:
    return {
        name: load_settings(ControllerSettings, read_preset(CONTROLLERS, name))
        for name in preset_names(CONTROLLERS)
    }


def designs() -> Iterator[tuple[str, str]]:
    for name, settings in controllers().items():
        law = design_law(settings)
        at = [] if law.params_at is None else [law.params_at(speed) for speed in SPEEDS_M_S]
        yield f"design of {name}", digest((law.params, at))


def motions() -> Iterator[tuple[str, str]]:
    path = build_path(CircleSettings(radius_m=30.0))
    for name in preset_names(PLANTS):
        plant = load_settings(PlantSettings, read_preset(PLANTS, name))
        motion = design_motion_arrays(plant.vehicle, plant.actuator, path, plant.disturbance)
        yield f"tables of {name}", digest(np.asarray(motion.table).tobytes())


def paths(folder: Path) -> Iterator[tuple[str, str]]:
    file = folder / "waypoints.csv"
    file.write_text("x_m,y_m\n0,0\n30,1.7\n61,-9.3\n70,20.1\n20,31.9\n")
    for settings in (
        EllipseSettings(),
        EllipseSettings(semi_major_axis_m=60.0, semi_minor_axis_m=30.0),
        SingleLaneChangeSettings(),
        DoubleLaneChangeSettings(),
        WaypointSettings(file=file),
        WaypointSettings(file=file, closed=True),
    ):
        yield f"path {settings.model_dump(exclude={'file'})}", digest(build_path(settings))


def runs(folder: Path) -> Iterator[tuple[str, str]]:
    file, log = folder / "plant.toml", folder / "run.log"
    of_each_law = {settings.law: (name, settings) for name, settings in controllers().items()}
    for (name, settings), down, up in zip(
        of_each_law.values(), cycle(JITTERS), cycle(reversed(JITTERS)), strict=False
    ):
        file.write_text(RUN.format(down=down, up=up), encoding="utf-8")
        plant = load_settings(PlantSettings, read_preset(PLANTS, "paper_corner_d"), file)
        result = run_virtual_pair(plant, settings, candump_log=log)
        yield f"log of {name}", digest(log.read_bytes())
        yield f"reports of {name}", digest((result.plant, result.controller))
        yield f"trace of {name}", digest(np.array(result.trace).tobytes())


def study(folder: Path) -> Iterator[tuple[str, str]]:
    text = (ROOT / "closed_loop" / "studies" / "paper_box.toml").read_text(encoding="utf-8")
    for whole, part in (("count = 512", "count = 2"), ("duration_s = 60.0", "duration_s = 4.0")):
        assert whole in text
        text = text.replace(whole, part)
    text = text.replace('_ddob"]', '_ddob", "practical_predictor"]')
    file = folder / "study.toml"
    file.write_text(text, encoding="utf-8")
    scenarios = Scenarios(load_study(file))
    store = Store(folder / "study", scenarios)
    store.open(text)
    assert run_missing(store, thread_workers(scenarios, 2), lambda _: None, lambda: False)
    yield "study", digest(store.results.read_bytes())


def results() -> dict[str, str]:
    """Return all digests by name."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = (designs(), motions(), paths(folder), runs(folder), study(folder))
        return dict(chain.from_iterable(made))


DISPATCHED = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
"""What numpy would use of this processor besides its baseline."""
AVX_512 = [name for name in DISPATCHED if name == "X86_V4" or "512" in name]
AVX_2 = [name for name in DISPATCHED if name in ("X86_V3", "AVX2")]
OLDEST = {
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": " ".join(DISPATCHED),
}
HASWELL = {
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "2",
    "NPY_DISABLE_CPU_FEATURES": " ".join(AVX_512),
}
SKYLAKE_X = {"OPENBLAS_CORETYPE": "SkylakeX"}


def results_as(processor: Mapping[str, str]) -> dict[str, str]:
    if not processor:
        return results()
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.loop.test_any_processor"],
        cwd=ROOT,
        env={**os.environ, **processor},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def oldest() -> dict[str, str]:
    return results_as(OLDEST)


THIS = pytest.param({}, DISPATCHED, id="this one")


@pytest.mark.parametrize(
    ("other", "needed"),
    sampled(
        [THIS],
        [
            THIS,
            pytest.param(HASWELL, AVX_2, id="Haswell, which needs AVX2"),
            pytest.param(SKYLAKE_X, AVX_512, id="SkylakeX, which needs AVX-512"),
        ],
    ),
)
def test_designs_runs_and_studies_have_the_bits_of_the_oldest_processor(
    other: Mapping[str, str],
    needed: Sequence[str],
    oldest: Mapping[str, str],
    request: pytest.FixtureRequest,
) -> None:
    if not needed:
        pytest.skip(f"not on this processor: {request.node.callspec.id}")
    found = results_as(other)
    assert found.keys() == oldest.keys()
    assert [what for what in oldest if found[what] != oldest[what]] == []


@compiled
def _product_less(a: float, b: float, c: float) -> float:
    return a * b - c


def test_compiled_code_fuses_no_product_with_a_sum() -> None:
    """A fused one keeps the product's last digits, 2⁻⁵⁴ here, which a rounded one has lost."""
    a = 1.0 + 2.0**-27
    assert _product_less(a, a, 1.0 + 2.0**-26) == 0.0


if __name__ == "__main__":
    json.dump(results(), sys.stdout)
