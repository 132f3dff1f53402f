"""A law of another package runs wherever ours do, to the same bits, or is refused in one line."""

import re
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import Outcome, run_compiled
from steer_by_wire.closed_loop.compiled.refusals import NotCompiledError
from steer_by_wire.closed_loop.compiled.step_functions import ForeignParamsError
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.closed_loop.studies.compiled_runs import Computer
from steer_by_wire.controller.command_line import program
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import ControllerStatus, LawNumber, Mode, Rejection, decode
from steer_by_wire.plant_emulator.evaluation.run_verdict import RUN_ENDS, RunEnd
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.runtime.settings.toml_text import dump_toml
from tests.support.runs.compiled_runs import assert_same_as_nodes, plant_settings
from tests.support.runs.small_study import make_scenarios, never

OWN = "own_law:LAW"
LAWS = "tests.support.nodes.plugin_laws"


@pytest.fixture(autouse=True)
def _examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "examples"))


def controller(law: str, *overrides: str) -> ControllerSettings:
    return controller_preset("practical_pd", ["followed_point=preview", f"law={law}", *overrides])


def run_nodes(
    settings: ControllerSettings, end_ns: int = 2_000_000_000
) -> tuple[ControllerNode, list[ControllerStatus]]:
    """Return the controller after a run of both nodes, and its statuses."""
    node, statuses = ControllerNode(settings, 0, samples_max=10_000), []

    def on_wire(_time_ns: int, _sender: int, frame: Frame) -> None:
        message = decode(frame)
        if not isinstance(message, Rejection) and isinstance(message[0], ControllerStatus):
            statuses.append(message[0])

    plant = PlantNode(plant_settings(()), 0)
    VirtualTimeExecutor((plant, node), None, on_wire).run(end_ns)
    return node, statuses


@pytest.mark.parametrize("around", [(), ("feed_forward={}",)], ids=["alone", "with feed-forward"])
def test_compiled_it_gives_the_bits_of_the_nodes(around: Sequence[str]) -> None:
    network = ["latency.downlink.mean_s=0.08", "latency.uplink.loss=0.1", "seed=3"]
    assert_same_as_nodes(plant_settings(network), controller(OWN, *around))


def test_compiled_it_may_give_a_function_to_another() -> None:
    assert_same_as_nodes(plant_settings(()), controller(f"{LAWS}:MAPS"))


def test_on_the_wire_it_is_custom_and_in_the_report_it_has_its_name() -> None:
    node, statuses = run_nodes(controller(OWN))
    assert {status.law for status in statuses} == {LawNumber.CUSTOM}
    assert node.report()["law"] == OWN
    assert node.report()["law_failures"] == 0


def test_a_plan_that_raises_leaves_single_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    example = import_module("networked_prediction")

    def raises(*_: object) -> int:
        raise ValueError

    monkeypatch.setattr(example, "RAISES", example.LAW._replace(plan=raises), raising=False)
    planned, alone = (
        run_nodes(controller_preset("highway_stiff_packet", [f"law=networked_prediction:{name}"]))[
            0
        ]
        for name in ("LAW", "RAISES")
    )
    assert planned.report()["plans_sent"] > 100
    assert alone.report()["plans_sent"] == alone.report()["law_failures"] == 0
    assert alone.report()["commands_sent"] == planned.report()["commands_sent"]


def test_its_settings_are_read_written_and_hashed(tmp_path: Path) -> None:
    settings = controller(OWN, "own_law.tracking_time_s=2")
    file = tmp_path / "own.toml"
    file.write_text(dump_toml(settings), encoding="utf-8")
    assert "[own_law]\nintegral_gain_rad_s_m = 0.5\ntracking_time_s = 2.0\n" in dump_toml(settings)
    again = load_settings(ControllerSettings, None, file)
    assert again == settings
    assert hash(again) == hash(settings)
    assert again.model_validate(settings.model_dump()) == settings


def test_a_law_without_pd_needs_no_table_pd_and_the_example_does() -> None:
    asleep = {"law": f"{LAWS}:DIVIDES", "nominal_model": {"kind": "paper_eq19"}}
    assert ControllerSettings.model_validate(asleep).pd is None
    with pytest.raises(ValueError, match=r"needs the table \[pd\]"):
        ControllerSettings.model_validate({**asleep, "law": OWN})


@pytest.mark.parametrize(
    ("law", "overrides", "line"),
    [
        ("nowhere.law:LAW", [], "the module nowhere.law cannot be imported: ModuleNotFoundError:"),
        (":LAW", [], "cannot be imported: ValueError: Empty module name"),
        ("own_law:NONE", [], "the module own_law has no NONE"),
        (f"{LAWS}:PLAIN", [], "is no law but of type dict: it has to be a steer_by_wire.Law"),
        (f"{LAWS}:NO_DESIGN", [], "its design fails: ZeroDivisionError: no gain"),
        (f"{LAWS}:NEEDS_TABLE", [], "own_law.gain_rad_m is missing (allowed: number above 0"),
        (OWN, ["own_law.tracking_tim_s=1"], "own_law: tracking_tim_s is not a known key (did you"),
        ("pd", ["own_law.gain=1"], "law = pd has no table of its own"),
    ],
)
def test_what_is_wrong_with_it_is_said_in_one_line(
    law: str, overrides: Sequence[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = [word for override in overrides for word in ("--set", override)]
    status = program.main(["--preset", "practical_pd", "--law", law, *sets, "--check"])
    errors = [text for text in capsys.readouterr().err.splitlines() if "error:" in text]
    assert status == 2
    assert len(errors) == 1
    assert line in errors[0]


def test_what_cannot_be_imported_is_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "leaves.py").write_text("import sys\nsys.exit('bye')\n")
    (tmp_path / "half.py").write_text("def law(:\n")
    with pytest.raises(SettingsError, match=r"leaves cannot be imported: SystemExit: bye$"):
        controller("leaves:LAW")
    with pytest.raises(SettingsError, match="half cannot be imported: SyntaxError: invalid syntax"):
        controller("half:LAW")


def test_check_analyses_a_linear_one_and_says_of_others_that_they_are_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def text(law: str) -> str:
        assert program.main(["--preset", "practical_pd", "--law", law, "--check"]) == 0
        return capsys.readouterr().out

    own = text(OWN)
    assert "# Margins without delay, at the command on the bus:" in own
    assert "#   delay margin  " in own
    other = text(f"{LAWS}:DIVIDES")
    reason = "# Not analysed: the law is not linear in the lateral error and its own commands.\n"
    assert reason in other
    assert other.startswith("# verdict: not analysed: see below for the reason\n")
    none = text(f"{LAWS}:NO_OUTPUT")
    assert "# Not analysed: the law has no finite answer to a small error.\n" in none


@pytest.mark.parametrize(
    ("law", "mistake"),
    [
        ("DIVIDES", ": ZeroDivisionError: float division by zero"),
        ("NOT_A_NUMBER", ""),
        ("NO_OUTPUT", ": TypeError: "),
        ("NO_REST", ": RuntimeError: no rest"),
        ("NO_SCHEDULE", ": ZeroDivisionError: no gain at this speed"),
    ],
)
def test_one_that_fails_is_held_started_anew_once_and_then_stopped(law: str, mistake: str) -> None:
    node, statuses = run_nodes(controller(f"{LAWS}:{law}"), 4_000_000_000)
    report = node.report()
    assert report["law_failures"] == 2
    assert report["failure"].startswith("the law's output was again not finite")
    assert f"restart of the law{mistake}" in report["failure"]
    assert node.finished
    assert Mode.HOLDING in {status.mode for status in statuses}
    assert all(np.isfinite(sample.sent_steer_rad) for sample in node.samples)


@pytest.mark.parametrize("law", ["DIVIDES", "NOT_A_NUMBER"])
def test_a_run_ends_where_it_fails_compiled_or_not(law: str) -> None:
    plant, settings = plant_settings((), 4.0), controller(f"{LAWS}:{law}")
    run = run_compiled(plant, settings)
    pair = make_virtual_pair(plant, settings, controller_samples_max=50)
    pair.run()
    assert run.outcome is Outcome.LAW_FAILED
    assert (len(run.tick_s), len(run.time_s)) == (50, 50)
    assert run.sent_rad.tolist() == [sample.sent_steer_rad for sample in pair.controller.samples]


def test_compiled_one_without_params_at_the_speed_of_the_run_is_refused_in_one_line() -> None:
    with pytest.raises(
        NotCompiledError, match=r"no params at 1\.\d+ m/s: ZeroDiv.* no gain at this speed$"
    ):
        run_compiled(plant_settings((), 1.0), controller(f"{LAWS}:NO_SCHEDULE"))


@pytest.mark.parametrize(
    ("law", "cause"),
    [
        ("NOT_COMPILED", r"Unknown attribute 'loads' of .*'json'.*plugin_laws\.py\", line \d+\)"),
        ("IMPORTS", r"Use of unsupported opcode \(IMPORT_NAME\) found.*plugin_laws\.py \(\d+\)"),
        ("KEYWORDS", "it does not say why"),
    ],
)
def test_what_numba_cannot_compile_is_refused_in_one_line(law: str, cause: str) -> None:
    with pytest.raises(NotCompiledError) as refused:
        run_compiled(plant_settings(()), controller(f"{LAWS}:{law}"))
    start = f"law = 'tests.support.nodes.plugin_laws:{law}': numba cannot compile it: "
    nodes = "; the nodes run it as it is: steer-by-wire run"
    assert re.fullmatch(re.escape(start) + cause + re.escape(nodes), str(refused.value))
    # The traceback of a script shows nothing of numba's.
    assert "site-packages" not in "".join(traceback.format_exception(refused.value))


def test_params_that_another_law_has_are_refused() -> None:
    run_compiled(plant_settings((), 4.0), controller(f"{LAWS}:DIVIDES"))
    with pytest.raises(ForeignParamsError, match="BORROWED': a compiled run needs params of"):
        run_compiled(plant_settings(()), controller(f"{LAWS}:BORROWED"))


def test_a_study_computes_it_compiled(tmp_path: Path) -> None:
    study = """
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd"]
[base.plant]
duration_s = 2.0
[base.controller]
law = "own_law:LAW"
own_law = { tracking_time_s = 0.7 }
"""
    computed = Computer(make_scenarios(tmp_path, study)).compute([0], never)
    assert computed.ends[0] == RUN_ENDS.index(RunEnd.COMPLETE)
