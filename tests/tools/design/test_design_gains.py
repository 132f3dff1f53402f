"""The design of gains: the search, refusals, and one run of the program."""

import json
import math
import re
from collections.abc import Callable
from functools import partial
from itertools import count
from pathlib import Path

import pytest

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.nominal_model import steer_to_lateral_error
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.pid import PidSettings
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.design import __main__ as design_gains
from steer_by_wire.tools.design.demands import Demand, Judgement, judge_law, make_bench
from steer_by_wire.tools.design.law_design import Design, design, failed
from steer_by_wire.tools.design.program import linear_laws
from steer_by_wire.tools.design.report import preset_text
from steer_by_wire.tools.design.search import evolution
from steer_by_wire.tools.design.search.evolution import Search, Values
from steer_by_wire.tools.design.search.law_parameters import bounds, controller_settings
from steer_by_wire.tools.design.search.parameter_search import cost, find
from steer_by_wire.tools.design.specification import Specification
from tests.support.loops.shipped_design import PAPER_VEHICLE, shipped_spec, shipped_vehicle
from tests.support.suite.same_process import same_process as same_process

SMALL = """
name = "small"
laws = ["pd"]
rate_hz = 50
peak_sensitivity_max = 3
noise_gain_rad_m_max = 4
[delay]
ms_max = 100
step_ms = 50
margin_ms = 50
[d_stability]
settling_1_s = 0.3
bandwidth_rad_s = 5
[course]
duration_s = 5
paths = [{ kind = "circle", radius_m = 30 }]
[search]
starts = 1
generations = 8
"""


def small_spec(folder: Path, *overrides: str) -> Specification:
    file = folder / "small.toml"
    file.write_text(SMALL)
    return load_settings(Specification, None, file, overrides)


# Searching


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Design:
    found = design(small_spec(tmp_path_factory.mktemp("spec")), shipped_vehicle(), "pd", math.inf)
    assert isinstance(found, Design)
    return found


def test_a_search_meets_all_demands(designed: Design) -> None:
    assert designed.found.feasible
    assert designed.found.judgement.violation == 0.0
    values = {demand.name: demand.value for demand in designed.found.judgement.demands}
    assert values["peak sensitivity"] <= 3.0
    assert values["noise gain"] <= 4.0
    settings = designed.preset.model_copy(update={"followed_point": "preview"})
    design_pd = design_law(settings)
    for corner in shipped_vehicle().corners:
        loop = SampledLoop(design_pd, steer_to_lateral_error(corner), settings.period_ns)
        assert all(loop.decay_1_s(ms * 1_000_000) > 0.3 for ms in (0, 50, 100))
        assert loop.is_stable(150_000_000)


def test_an_unstable_law_is_judged_by_how_many_of_its_loops_are() -> None:
    bench = make_bench(shipped_spec(), shipped_vehicle(), fine=False)
    wild = judge_law(bench, "pd", {"k_p": 10.0, "k_d": 1.0, "derivative_filter": 100.0})
    assert math.isinf(wild.objective)
    assert wild.violation > 100.0


def test_a_nearly_met_demand_raises_the_objective_and_a_far_one_ranks_behind() -> None:
    costs = [cost(Judgement(2.0, violation, ())) for violation in (0.0, 0.1)]
    assert costs == pytest.approx([2.0, 4.0])
    assert cost(Judgement(math.inf, 0.7, ())) == pytest.approx(1.7e6)


def test_a_demand_left_out_keeps_no_law_from_its_runs(tmp_path: Path) -> None:
    spec, values = small_spec(tmp_path), {"k_p": 0.2, "k_d": 0.01, "derivative_filter": 1.0}

    def judged(*left_out: str) -> Judgement:
        bench = make_bench(spec, shipped_vehicle(), fine=False, without=frozenset(left_out))
        return judge_law(bench, "pd", values)

    missed = [each.name for each in judged("settling").demands if each.excess]
    assert 0 < len(missed) < 4
    assert math.isinf(judged("settling").objective)
    assert math.isfinite(judged("settling", *missed).objective)


def test_a_known_design_takes_the_place_of_the_first_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begun: list[tuple[Values | None, float]] = []

    def evolve(
        _: Search, _seed: int, _generations: int, near: Values | None, spread: float
    ) -> None:
        begun.append((near, spread))

    bench = make_bench(small_spec(tmp_path, "search.starts=2"), shipped_vehicle(), fine=False)
    known = {"k_p": 1.48, "k_d": 0.061, "derivative_filter": 27.0}
    monkeypatch.setattr(Search, "evolve", evolve)
    monkeypatch.setattr(Search, "best", lambda *_: [known])
    find(bench, bench, "pd", math.inf, known)
    assert begun == [(known, 0.05), (None, 0.25)]


def ridge(values: Values) -> float:
    """Rosenbrock's function of the logarithms; least where both are 1, on a bent ridge."""
    x, y = (math.log(value) for value in values.values())
    return 100.0 * (y - x**2) ** 2 + (1.0 - x) ** 2


def cornered(values: Values) -> float:
    """Falls with both down to where their product has to be 1: at (0.5, 2)."""
    x, y = values.values()
    return 1e6 * (2.0 - x * y) if x * y < 1.0 else 4.0 * x + y


@pytest.mark.parametrize(
    ("function", "minimum"), [(ridge, [math.e, math.e]), (cornered, [0.5, 2.0])]
)
def test_the_evolution_follows_a_ridge_and_a_demand_to_the_minimum(
    function: Callable[[Values], float], minimum: list[float]
) -> None:
    search = Search(function, {"x": (0.1, 10.0), "y": (0.1, 10.0)})
    search.evolve(3, 200)
    (best,) = search.best(1)
    assert list(best.values()) == pytest.approx(minimum, rel=0.02)
    assert all(float(f"{value:.3g}") == value for value in best.values())
    assert search.least == function(best)
    again = Search(function, {"x": (0.1, 10.0), "y": (0.1, 10.0)})
    again.evolve(3, 200)
    assert again.best(99) == search.best(99)


# Stopping


def test_a_stopped_search_keeps_its_best(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(evolution, "monotonic", partial(next, count()))
    spec, vehicle = small_spec(tmp_path), shipped_vehicle()
    stopped = design(spec, vehicle, "pd", until_s=50.0)
    assert isinstance(stopped, Design)
    assert not stopped.found.ended
    assert "stopped before its end" in preset_text(spec, vehicle, stopped, ("car", "small.toml"))


# Refusals


def test_gains_stay_within_bounds_that_no_filter_of_the_rate_exceeds() -> None:
    ranges = bounds("pd_ddob", shipped_vehicle().vehicle.vehicle, 10.0)
    assert all(0.0 < low < high for low, high in ranges.values())
    assert max(high for key, (_, high) in ranges.items() if key[:2] != "k_") < math.pi * 10.0


def test_a_value_just_above_its_limit_is_shown_with_the_digits_that_differ() -> None:
    demands = (Demand("peak sensitivity", 3.2004, 3.2), Demand("noise gain", 5.0, 4.0))
    assert failed(Judgement(1.0, 1.0, demands)) == [
        "peak sensitivity 3.2004 above 3.2",
        "noise gain 5 above 4 rad/m",
    ]


# The program


@pytest.mark.usefixtures("same_process")
def test_a_law_that_fails_its_demands_is_refused_and_its_best_kept_as_unmet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steer_by_wire.tools.design.search.parameter_search._FINE_GENERATIONS", 1)
    small_spec(tmp_path)
    status = design_gains.main(
        [
            str(PAPER_VEHICLE),
            *("--spec", str(tmp_path / "small.toml"), "--out", str(tmp_path)),
            *("--set", "rms_m_max.pd=0.001", "--set", "search.generations=4"),
        ]
    )
    printed, error = capsys.readouterr()
    assert status == 1
    assert re.search(
        r"pd\.proportional_gain_rad_m = .*\) fails: .*RMS error .* above 0.001 m",
        error,
        re.MULTILINE,
    )
    assert not (tmp_path / "small_pd.toml").exists()
    kept = tmp_path / "small_pd.unmet.toml"
    assert f"no preset; the best so far -> {kept}" in printed
    first, *_ = kept.read_text(encoding="utf-8").splitlines()
    assert first == "# NOT A DESIGN: this pd fails demands of small.toml for paper_vehicle.toml."
    (row,) = (line for line in printed.splitlines() if line.startswith("  RMS error"))
    assert re.fullmatch(r"  RMS error +NOT MET +\d\.\d+ m, at most 0.001 m", row)
    assert "  settling          met" in printed.splitlines()
    assert f"# {row}" in kept.read_text(encoding="utf-8").splitlines()
    assert load_settings(ControllerSettings, None, kept).law == "pd"


ONE_CONDITION = """
[predictor]
fallback = "practical_pd_ddob"
delay_ms_max = 100
delay_step_ms = 100
generations = 1
[[predictor.conditions]]
mean_ms = 50
error_m_max = {limit}
"""


def of_a_predictor(folder: Path, limit_m: float) -> list[str]:
    """Write a specification with one condition; returns the words of the command."""
    text = SMALL.replace('["pd"]', '["predictor"]').replace("rate_hz = 50", "rate_hz = 100")
    (folder / "small.toml").write_text(text + ONE_CONDITION.format(limit=limit_m))
    words = [str(PAPER_VEHICLE), "--spec", str(folder / "small.toml"), "--out", str(folder)]
    return [*words, "--json", str(folder / "figures.json")]


def demands_exceeded(folder: Path) -> list[str]:
    found = json.loads((folder / "figures.json").read_text("utf-8"))["laws"]["predictor"]
    exceeded = [one["name"] for one in found["demands"] if one["value"] > one["limit"]]
    assert found["is_met"] is not bool(exceeded)
    return exceeded


@pytest.mark.usefixtures("same_process")
@pytest.mark.parametrize(("limit_m", "exceeded"), [(10.0, []), (1e-6, ["condition 1"])])
def test_a_predictor_is_a_preset_if_it_meets_all_its_conditions_and_else_unmet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limit_m: float, exceeded: list[str]
) -> None:
    assert design_gains.main(of_a_predictor(tmp_path, limit_m)) == len(exceeded)
    assert demands_exceeded(tmp_path) == exceeded
    kept = {path.name for path in tmp_path.glob("small_predictor*.toml")}
    assert kept == {"small_predictor.unmet.toml" if exceeded else "small_predictor.toml"}
    if exceeded:
        printed = capsys.readouterr()
        assert "error: predictor: 1 of 4 demands are not met" in printed.err
        assert "  condition 1       NOT MET" in printed.out


def test_a_specification_asks_for_the_heading_gain_of_a_pid(tmp_path: Path) -> None:
    spec = small_spec(
        tmp_path, 'laws=["pd", "pid"]', "pid_heading_gain=true", "d_stability.settling_1_s=0.1"
    )
    assert linear_laws(spec) == ["pd", "pid_heading"]
    values = {"k_p": 0.2, "k_d": 1.32, "derivative_filter": 1.84, "k_i": 7.2, "k_heading": 0.8}
    bench = make_bench(spec, shipped_vehicle(), fine=False)
    judged = judge_law(bench, "pid_heading", values)
    assert judged.violation == 0.0
    settings = controller_settings(spec, shipped_vehicle(), "pid_heading", values)
    assert settings.law == "pid"
    assert settings.table_of(PidSettings).heading_gain_rad_rad == 0.8
    assert linear_laws(small_spec(tmp_path, 'laws=["pid"]')) == ["pid"]


@pytest.mark.usefixtures("same_process")
def test_the_program_leaves_a_preset_and_a_picture(
    designed: Design, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = small_spec(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL.replace("duration_s = 5", "duration_s = 6"))
    out, pictures = tmp_path / "presets", tmp_path / "pictures"
    status = design_gains.main(
        [
            str(PAPER_VEHICLE),
            *("--spec", str(tmp_path / "small.toml")),
            *("--out", str(out), "--pictures", str(pictures)),
            *("--set", "course.duration_s=5"),
        ]
    )
    printed = capsys.readouterr()
    assert status == 0, printed.err
    sources = (PAPER_VEHICLE.name, "small.toml")
    # The same demands give the same preset.
    text = preset_text(spec, shipped_vehicle(), designed, sources)
    assert (out / "small_pd.toml").read_text(encoding="utf-8") == text
    settings = load_settings(ControllerSettings, None, out / "small_pd.toml")
    assert settings.law == "pd"
    assert (pictures / "small_pd.png").stat().st_size > 20_000
    assert "pd.proportional_gain_rad_m = " in printed.out
    rig = load_settings(PlantSettings, None, pictures / "small_plant.toml")
    assert rig.vehicle == VehicleSettings(**shipped_vehicle().vehicle.vehicle._asdict())
    assert rig.duration_s == 5.0
    words = [str(PAPER_VEHICLE), "--spec", str(tmp_path / "small.toml"), "--pictures"]
    assert design_gains.main([*words, str(pictures), "--out", str(tmp_path / "other")]) == 2
    assert "has another run, whose small_plant.toml differs" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("table", "line", "complaint"),
    [
        ("vehicle", "wheels = 4", "wheels"),
        ("vehicle", "[uncertainty]\nspeed_m_s = [2, 1]", "minimum must be below"),
        ("vehicle", "[uncertainty]\nspeed_m_s = [1.5]", "uncertainty.speed_m_s"),
        ("vehicle", "[uncertainty]\nspeed_m_s = [2, 3]", "must lie within its range"),
        ("vehicle", "[uncertainty]\ncolour = [2, 3]", "colour"),
        ("vehicle", "[uncertainty]\nspeed_m_s = [0.1, 3]", "plant emulator cannot drive"),
        ("spec", 'laws = ["lqr"]', "laws"),
        ("spec", "laws = []", "laws"),
        ("spec", 'laws = ["pd", "pd"]', "twice"),
        ("spec", "delay.ms_max = -1", "ms_max"),
        ("spec", "delay.step_ms = 0", "step_ms"),
        ("spec", "delay.margin_ms = 1999\ndelay.step_ms = 1", "500 delays"),
        ("spec", "course.paths = []", "paths"),
        ("spec", "ignore_s = 9", "must be below course.duration_s"),
        ("spec", "peak_sensitivity_max = 0.5", "peak_sensitivity_max"),
        ("spec", "d_stability.cone_angle_deg = 45", "cone_angle_deg"),
        ("spec", "d_stability.bandwidth_rad_s = 0.1", "radius"),
        ("spec", "d_stability.bandwidth_rad_s = 1000", "must be below pi * rate_hz"),
        ("spec", "course.friction_share_max = 0.006", "0.01 of what friction 1 gives; at most"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, line: str, complaint: str
) -> None:
    vehicle, spec = tmp_path / "vehicle.toml", tmp_path / "spec.toml"
    nominal, _, _ = PAPER_VEHICLE.read_text().partition("[uncertainty]")
    vehicle.write_text(nominal + (line if table == "vehicle" else ""))
    spec.write_text(SMALL)
    overrides = line.splitlines() if table == "spec" else []
    options = [option for override in overrides for option in ("--set", override)]
    assert design_gains.main([str(vehicle), "--spec", str(spec), *options]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("steer-by-wire design: error: ")
    assert complaint in said
