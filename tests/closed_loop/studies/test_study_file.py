"""Study files: what they may say, which points they stand for, and what is refused in one line."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.factors import Factor, Level, make_design, make_factor
from steer_by_wire.closed_loop.studies.scenario import Scenarios, replicate_seed
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.closed_loop.studies.study_file import (
    FactorSettings,
    SamplingKind,
    SamplingSettings,
)
from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict, VerdictRules
from steer_by_wire.plant_emulator.sensors.settings import PathAheadSettings
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError, read_preset
from tests.support.runs.small_study import CORNERS
from tests.support.suite.shown_blocks import blocks_of

SHIPPED = Path(__file__).resolve().parents[3] / "closed_loop" / "studies"
BASE = """
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_pd_ddob"]
"""


def scenarios(tmp_path: Path, text: str, base: str = BASE) -> Scenarios:
    file = tmp_path / "study.toml"
    file.write_text(base + text, encoding="utf-8")
    made = Scenarios(load_study(file))
    made.check()
    return made


def overrides(made: Scenarios) -> list[dict[str, Any]]:
    return [dict(made.case(index).overrides) for index in range(made.study.cases)]


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.toml")), ids=lambda file: file.stem)
def test_what_is_shipped_can_be_run(file: Path) -> None:
    made = Scenarios(load_study(file))
    made.check()
    assert made.study.settings.name == file.stem


def test_an_empty_table_of_the_base_is_what_it_is_in_a_settings_file(tmp_path: Path) -> None:
    made = scenarios(tmp_path, "", BASE + "[base.plant]\npath_ahead = {}\n")
    assert made.plant(made.case(0)).path_ahead == PathAheadSettings()


def test_a_grid_has_every_combination_once_for_every_controller(tmp_path: Path) -> None:
    made = scenarios(
        tmp_path,
        """
[[factors]]
key = "plant.latency.downlink.mean_s"
start = 0.0
stop = 0.3
step = 0.1
[[factors]]
key = "controller.rate_hz"
values = [50, 100]
[sampling]
replicates = 3
""",
    )
    assert made.study.cases == 4 * 2 * 3
    assert made.study.runs == 2 * made.study.cases
    found = Counter(
        (case["plant.latency.downlink.mean_s"], case["controller.rate_hz"])
        for case in overrides(made)
    )
    assert found == {(mean, rate): 3 for mean in (0.0, 0.1, 0.2, 0.3) for rate in (50, 100)}
    pair = made.pair(made.study.runs - 1)
    assert pair.plant.latency.downlink.mean_s == 0.3
    assert pair.controller.rate_hz == 100.0
    assert pair.controller.law == "pd_ddob"


def test_all_controllers_and_points_of_a_replicate_meet_the_same_network(tmp_path: Path) -> None:
    made = scenarios(
        tmp_path,
        """
[[factors]]
key = "plant.vehicle.speed_m_s"
values = [4.0, 7.0]
[sampling]
replicates = 2
seed = 5
""",
    )
    seeds = [made.pair(run).plant.seed for run in range(made.study.runs)]
    assert seeds == [replicate_seed(5, 0)] * 2 + [replicate_seed(5, 1)] * 2 + seeds[:4]
    assert len(set(seeds)) == 2
    assert seeds[0] != replicate_seed(6, 0)


def test_the_seed_of_a_replicate_is_what_it_was() -> None:
    """Part of what a stored study means: it must never change."""
    assert replicate_seed(1, 0) == 3717377837946358015
    assert replicate_seed(1086, 3) == 4247236606399973844


def test_jitter_can_be_given_as_a_share_of_the_mean(tmp_path: Path) -> None:
    made = scenarios(
        tmp_path,
        """
[base.plant.latency.uplink]
model = "gamma"
mean_s = 0.05
[[factors]]
key = "plant.latency.uplink.spread_fraction"
values = [0.0, 0.5]
""",
    )
    none, half = (made.pair(2 * case).plant.latency.uplink for case in range(2))
    assert (none.model, none.mean_s, none.spread_s) == ("constant", 0.05, 0.0)
    assert (half.model, half.mean_s, half.spread_s) == ("gamma", 0.05, 0.025)


def test_the_corners_are_those_of_the_presets(tmp_path: Path) -> None:
    made = scenarios(tmp_path, CORNERS)
    for place, corner in enumerate("abcd"):
        expected = plant_preset(f"paper_corner_{corner}").vehicle
        assert made.case(place).labels == (corner,)
        assert made.pair(2 * place).plant.vehicle == expected


def test_a_path_can_be_given_by_name_and_levels_can_set_several_keys(tmp_path: Path) -> None:
    made = scenarios(
        tmp_path,
        """
[[factors]]
key = "plant.path"
values = ["paper_ellipse", "double_lane_change", { kind = "circle", radius_m = 30.0 }]
[[factors]]
name = "network"
[factors.levels.good]
[factors.levels.bad]
plant.latency.downlink = { loss = 0.1, mean_s = 0.1 }
controller.supervision.hold_ms = 100.0
""",
    )
    paths = [made.pair(run).plant.path for run in range(made.study.runs)]
    assert PlantSettings().path in paths
    assert {path.kind for path in paths} == {"ellipse", "double_lane_change", "circle"}
    by_label = {made.case(index).labels[0]: made.pair(2 * index) for index in range(6)}
    assert by_label["bad"].plant.latency.downlink.loss == 0.1
    assert by_label["bad"].controller.supervision.hold_ms == 100.0
    assert by_label["good"].plant.latency.downlink.loss == 0.0


def test_a_table_that_changes_its_kind_loses_the_keys_of_the_other(tmp_path: Path) -> None:
    made = scenarios(tmp_path, '[[factors]]\nkey = "plant.path.kind"\nvalues = ["circle"]\n')
    assert made.pair(0).plant.path.model_dump() == {"kind": "circle", "radius_m": 50.0}


def ranged(is_grid: bool, **range_: Any) -> Factor:
    return make_factor(FactorSettings(key="plant.x", **range_), is_grid, "here")


def test_ranges_have_both_ends_and_no_digits_of_rounding() -> None:
    for range_, values in (
        ({"start": 0.0, "stop": 0.4, "step": 0.1}, (0.0, 0.1, 0.2, 0.3, 0.4)),
        ({"start": 0.0, "stop": 0.35, "step": 0.1}, (0.0, 0.1, 0.2, 0.3)),
        ({"start": 1.0, "stop": 2.0, "count": 5}, (1.0, 1.25, 1.5, 1.75, 2.0)),
        ({"start": 3.0, "stop": 3.0, "count": 1}, (3.0,)),
        ({"start": 0.01, "stop": 100.0, "count": 3, "scale": "log"}, (0.01, 1.0, 100.0)),
    ):
        assert ranged(True, **range_).labels == values
    drawn = ranged(False, start=0.01, stop=1.0, scale="log")
    assert drawn.at(0.5).label == pytest.approx(0.1)


def test_a_sobol_sequence_fills_every_quarter_and_goes_on_where_it_was() -> None:
    factors = tuple(Factor(name, (name,), None, lambda u: u) for name in ("one", "two"))
    few, many = (
        make_design(factors, SamplingSettings(kind=SamplingKind.SOBOL, count=count)).uniforms
        for count in (16, 20)
    )
    assert few is not None
    assert many is not None
    np.testing.assert_array_equal(many[:16], few)
    quarters = Counter(map(tuple, np.floor(4 * few).tolist()))
    assert set(quarters.values()) == {1}
    assert len(quarters) == 16


def test_levels_are_equally_likely_where_points_are_drawn() -> None:
    factor = Factor("x", ("x",), tuple(Level(label, ()) for label in "abcd"), None)
    found = Counter(factor.at((index + 0.5) / 400).label for index in range(400))
    assert found == dict.fromkeys("abcd", 100)


BAD: dict[str, tuple[str, str]] = {
    "beyond a range": (
        '[[factors]]\nkey = "plant.latency.downlink.mean_s"\nvalues = [0.1, 20.0]\n',
        r"study\.toml: factor mean_s: plant\.latency\.downlink\.mean_s = 20\.0 .*allowed: number "
        r"from 0\.0, up to",
    ),
    "a key that is not there": (
        '[[factors]]\nkey = "plant.latency.downlink.means"\nvalues = [0.1]\n',
        r"factor means: plant\.latency\.downlink\.means is not a known key \(did you mean "
        r"plant\.latency\.downlink\.mean_s\?\)",
    ),
    "a key of no program": (
        '[[factors]]\nkey = "speed"\nvalues = [1.0]\n',
        r"factor speed: key speed starts with none of plant\., controller\., hand_wheel\.",
    ),
    "text for a number": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nvalues = ["5"]\n',
        r"factor speed_m_s: plant\.vehicle\.speed_m_s = \"5\" should be a valid number",
    ),
    "jitter of a constant latency": (
        '[[factors]]\nkey = "plant.latency.downlink.spread_s"\nvalues = [0.1]\n',
        r"spread_s needs a model other than 'constant'",
    ),
    "a share that is none": (
        '[[factors]]\nkey = "plant.latency.downlink.spread_fraction"\nvalues = [-0.1]\n',
        r"spread_fraction = -0\.1 \(allowed: number from 0, up to 100\)",
    ),
    "values and a range": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0]\nstart = 4.0\n',
        r"study\.toml: factors\[0\]: a factor has one of .*; this one has both values and start",
    ),
    "no key": ("[[factors]]\nvalues = [5.0]\n", r"factors\[0\]: a factor has either key or keys"),
    "a range without step": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nstart = 4.0\nstop = 5.0\n',
        r"factors\[0\]: the range of factor speed_m_s needs step or count in a grid",
    ),
    "a logarithmic range from 0": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nstart = 0.0\nstop = 5.0\nscale = "log"\n',
        r"factors\[0\]: a logarithmic range begins above 0 and has no step",
    ),
    "a scale without a range": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0]\nscale = "log"\n',
        r"factors\[0\]: scale belongs to start and stop",
    ),
    "the same key twice": (
        CORNERS + '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0]\n',
        r"factors corner and speed_m_s both set plant\.vehicle\.speed_m_s",
    ),
    "a name that is taken": (
        '[[factors]]\nname = "id"\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0]\n',
        r"factor id: a column of the results has this name already",
    ),
    "the name of a figure": (
        '[[factors]]\nname = "rms_m"\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0]\n',
        r"factor rms_m: a column of the results has this name already",
    ),
    "the same value twice": (
        '[[factors]]\nkey = "plant.vehicle.speed_m_s"\nvalues = [5.0, 5.0]\n',
        r"values of factor speed_m_s must differ",
    ),
    "a seed of its own": (
        '[[factors]]\nname = "x"\nkey = "plant.seed"\nvalues = [5]\n',
        r"plant\.seed follows from sampling\.seed; ask for sampling\.replicates",
    ),
    "a range of hand wheels": (
        '[sampling]\nkind = "sobol"\ncount = 2\n[base.hand_wheel]\ncycle_ms = 5.0\n'
        '[[factors]]\nkey = "hand_wheel"\nstart = 0.0\nstop = 1.0\n',
        r"factor hand_wheel: hand_wheel takes presets and files: give values",
    ),
    "no count": ('[sampling]\nkind = "sobol"\n', r"sampling: sobol needs count"),
    "a count for a grid": ("[sampling]\ncount = 5\n", r"sampling: count does not apply to a grid"),
    "an unknown table": (
        "[sampeling]\n",
        r"sampeling is not a known key \(did you mean sampling\?\)",
    ),
    "a base that cannot be": (
        "[base.plant]\nduration_s = -1.0\n",
        r"study\.toml: base\.plant: duration_s = -1\.0 should be greater than 0",
    ),
    "thresholds of single runs": (
        "[base.plant.verdict]\nroad_m = 1.0\n",
        r"plant\.verdict is for single runs: give the study's own table \[verdict\]",
    ),
    "thresholds as a factor": (
        '[[factors]]\nkey = "plant.verdict.road_m"\nvalues = [1.0, 2.0]\n',
        r"the study's own table \[verdict\]",
    ),
    "faults for all runs": (
        '[[base.plant.faults]]\nkind = "drop"\ndirection = "uplink"\n',
        r"study\.toml: base\.plant sets faults, which need a bus: add \[base\.bus\]",
    ),
    "faults of a factor": (
        '[[factors]]\nname = "x"\n[factors.levels.lossy]\n'
        'plant.faults = [{ kind = "drop", direction = "uplink" }]\n',
        r"study\.toml: factor x sets faults, which need a bus",
    ),
    "faults of a variant": (
        '[base.variants.lossy]\npreset = "practical_pd"\n'
        '[[base.variants.lossy.plant.faults]]\nkind = "drop"\ndirection = "uplink"\n',
        r"study\.toml: base\.variants\.lossy sets faults, which need a bus",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_study_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    text, expected = BAD[case]
    with pytest.raises(SettingsError, match=expected) as caught:
        scenarios(tmp_path, text)
    assert len(caught.value.mistakes) == 1


def test_a_controller_that_is_not_there_is_refused(tmp_path: Path) -> None:
    base = '[base]\ncontrollers = ["practical_pdd"]\n'
    with pytest.raises(SettingsError, match="did you mean practical_pd"):
        scenarios(tmp_path, "", base)


def test_a_controller_can_be_a_file_beside_the_study(tmp_path: Path) -> None:
    text = read_preset("steer_by_wire.controller.presets", "practical_pd").text
    (tmp_path / "mine.toml").write_text(text.replace("rate_hz = 100", "rate_hz = 50"))
    made = scenarios(tmp_path, "", '[base]\ncontrollers = ["mine.toml", "practical_pd"]\n')
    assert [made.pair(run).controller.rate_hz for run in range(2)] == [50.0, 100.0]


def test_factors_keep_their_labels_and_keys() -> None:
    settings = FactorSettings(keys=("plant.a", "plant.b"), values=(1, 2))
    factor = make_factor(settings, True, "here")
    assert (factor.name, factor.labels) == ("a", (1, 2))
    assert (factor.levels or ())[0].values == (("plant.a", 1), ("plant.b", 1))


def test_the_studies_in_the_documentation_are_accepted(tmp_path: Path) -> None:
    docs = SHIPPED.parent.parent / "docs" / "studies.md"
    blocks = blocks_of(docs.read_text(encoding="utf-8"))
    study, bus = (block.text for block in blocks if block.language == "toml")
    text = read_preset("steer_by_wire.controller.presets", "practical_pd").text
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    made = scenarios(tmp_path, study, base="")
    assert made.study.runs == 11 * 3 * 2 * 5 * 3
    over_a_bus = scenarios(tmp_path, f"{study}\n{bus}", base="")
    assert over_a_bus.study.runs == 3 * made.study.runs


def test_the_documentation_names_every_figure_and_verdict() -> None:
    text = (SHIPPED.parent.parent / "docs" / "studies.md").read_text(encoding="utf-8")
    words = {*COLUMNS, *map(str, Verdict), *VerdictRules.model_fields}
    assert sorted(word for word in words if f"`{word}`" not in text) == []
