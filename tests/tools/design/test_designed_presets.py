"""The shipped presets are what the design of gains puts out, and keep what their files state."""

import re
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import pytest

from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.design.demands import Bench, judge_law, make_bench
from steer_by_wire.tools.design.law_design import describe
from steer_by_wire.tools.design.predictor_design import Task, describe_predictor, predictor_demands
from steer_by_wire.tools.design.report import predictor_figures, preset_text
from steer_by_wire.tools.design.road import on_road
from steer_by_wire.tools.design.search.evolution import Values
from steer_by_wire.tools.design.search.law_parameters import KEYS, SETTINGS_KEYS
from steer_by_wire.tools.design.search.parameter_search import Found, confirm
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile
from steer_by_wire.tools.design.virtual_check import drive, jittered, plants
from tests.support.loops.shipped_design import PAPER_VEHICLE, SHIPPED, shipped_spec, shipped_vehicle
from tests.support.suite.combinations import sampled

RMS_M_MAX = 0.011
GAIN_DESIGN = Path(__file__).parents[3] / "tools" / "design"


def shipped_preset(name: str = "practical_pd_ddob") -> ControllerSettings:
    return controller_preset(name)


def shipped_values(name: str, law: str) -> Values:
    settings, places = shipped_preset(name).model_dump(), [SETTINGS_KEYS[key] for key in KEYS[law]]
    found = (settings[table][field] for table, field in (place.split(".") for place in places))
    return dict(zip(KEYS[law], found, strict=True))


def vehicle_of(family: str) -> Path:
    return SHIPPED / "highway_vehicle.toml" if family == "highway" else PAPER_VEHICLE


@cache
def fine_bench(family: str) -> Bench:
    """All of the file but the jitter, which takes long in virtual time."""
    spec = load_settings(Specification, None, SHIPPED / f"{family}.toml", ["jitter=[]"])
    return make_bench(spec, load_settings(VehicleFile, None, vehicle_of(family)), fine=True)


SAMPLE = (("practical", "pd_ddob"), ("highway", "pd"))
"""The law with every filter, slow, and the plainest, fast."""
WHOLE = (
    *(*SAMPLE, *(("practical", law) for law in ("pd", "pid", "pd_dob", "pd_cdob"))),
    *(("practical_half_second", "pd_ddob"), ("practical_long_delay", "pd_ddob")),
    ("highway", "pd_ddob"),
)
PREDICTORS = (
    ("practical_predictor", "paper_vehicle", "practical_predictor"),
    ("highway_predictor", "sedan_vehicle", "road"),
    ("highway_packet", "sedan_vehicle", "road"),
    ("highway_unknown_path_predictor", "sedan_vehicle", "road_unknown_path"),
    ("highway_stiff_predictor", "highway_vehicle", "highway_stiff"),
)


@pytest.mark.parametrize(("family", "law"), sampled(SAMPLE, WHOLE))
def test_a_designed_preset_says_what_is_measured_anew(family: str, law: str) -> None:
    name, bench = f"{family}_{law}", fine_bench(family)
    values = shipped_values(name, law)
    judgement, confirmation = judge_law(bench, law, values), confirm(bench, law, values)
    found = Found(law, values, judgement, confirmation, judged=0)
    assert judgement.violation == 0.0
    sources = (vehicle_of(family).name, f"{family}.toml")
    text = preset_text(bench.spec, bench.vehicle, describe(bench, found), sources)
    lines = read_preset("steer_by_wire.controller.presets", name).text.splitlines(keepends=True)
    assert text == "".join(line for line in lines if not line.startswith("#   jitter"))


def test_the_ddob_preset_keeps_under_jitter_what_its_file_states() -> None:
    """The spread and the loss that the preset was made for, at the corner that is the worst."""
    spec, vehicle, settings = shipped_spec(), shipped_vehicle(), shipped_preset()
    text = read_preset("steer_by_wire.controller.presets", "practical_pd_ddob").text
    stated = [float(value) for value in re.findall(r"# +jitter +([\d.]+) m", text)]
    assert len(stated) == len(spec.jitter) == 2
    for table, rms_m in zip(spec.jitter, stated, strict=True):
        asked = plants(spec, vehicle, [jittered(table)])
        worst_m = max(drive(spec, each, settings).rms_m for each in asked)
        assert worst_m == pytest.approx(rms_m, abs=6e-5)
        assert worst_m < RMS_M_MAX


@pytest.mark.parametrize(
    ("preset", "vehicle", "specification"), sampled(PREDICTORS[:2], PREDICTORS)
)
def test_a_designed_predictor_says_what_is_measured_anew(
    preset: str, vehicle: str, specification: str
) -> None:
    text = read_preset("steer_by_wire.controller.presets", preset)
    settings = load_settings(ControllerSettings, text)
    spec = load_settings(Specification, None, GAIN_DESIGN / f"{specification}.toml")
    box = load_settings(VehicleFile, None, GAIN_DESIGN / f"{vehicle}.toml")
    if spec.road is not None:
        box = on_road(spec.road, box)
    with ThreadPoolExecutor(2) as pool:
        design = describe_predictor(Task(pool, spec, box), settings)
    said = re.findall(
        r"^#   (RMS error|jitter|noise gain|peak sensitivity|largest error|no PATH_AHEAD"
        r"|without echoes) +(.*)$",
        text.text,
        re.MULTILINE,
    )
    assert said == list(predictor_figures(spec, design))
    if spec.road is not None and spec.road.path_known:
        assert design.road_m[:, 0].max() < 0.15
        assert design.road_m[:, 1].max() < 0.3
    assert not any(demand.excess for demand in predictor_demands(spec, design))
