"""README, Start and How to: their names, and the commands that need no root or hardware."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from steer_by_wire import Run, simulate
from steer_by_wire.command import PROGRAMS
from steer_by_wire.tools.cockpit.sampler import IN_LANE_M
from tests.support.programs.cockpit_pictures import LAWS, moving_plant
from tests.support.programs.running_program import ORDINARY, PATIENCE_S, UNSUPERVISED
from tests.support.suite.shown_blocks import PAGES, RIG_ALONE, ROOT, blocks_of

README, START, HOW_TO = (PAGES[page] for page in ("README.md", "docs/start.md", "docs/how_to.md"))
BARE = """
import re
import sys
from importlib.metadata import requires

from steer_by_wire.command import PROGRAMS, main
from steer_by_wire.runtime.command_line import DISTRIBUTION

OPTIONAL = [re.match("[a-z0-9-]+", it)[0] for it in requires(DISTRIBUTION) if "extra ==" in it]

class OnlyWhatIsRequired:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in OPTIONAL:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, OnlyWhatIsRequired())
for name in PROGRAMS:
    try:
        status = main([name, "--help"])
    except SystemExit as end:
        status = end.code
    print(name, status, file=sys.stderr)
"""
"""Starts every program as if no extra were installed, and prints the status of each."""


def block_with(line: str) -> str:
    """Return the one block of commands with a line."""
    texts = [block.text for block in (*blocks_of(README), *blocks_of(START))]
    (text,) = [text for text in texts if line in text.splitlines()]
    return text


def environment(folder: Path) -> dict[str, str]:
    """Return an environment with our programs, and with a default bus of its own."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "XDG_RUNTIME_DIR": str(folder)}


@pytest.mark.parametrize("target", re.findall(r"^make (\w+)", README + START, re.MULTILINE))
def test_it_names_make_targets_that_exist(target: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_it_lists_every_program_of_the_one_command() -> None:
    _, _, table = HOW_TO.partition("| `steer-by-wire ...` | |")
    cells = re.findall(r"^\| (`[^|]*`) \|", table.partition("\n\n")[0], re.MULTILINE)
    named = {words.split()[0] for cell in cells for words in re.findall(r"`([^`]+)`", cell)}
    assert named == {*PROGRAMS}


def test_what_follows_the_installation_runs_as_printed(tmp_path: Path) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    install, *further = block_with("steer-by-wire --help").splitlines()
    assert install == "pip install '.[tools]'"
    result = subprocess.run(
        [bash, "-e", "-c", "\n".join([*further, "complete -p steer-by-wire"])],
        cwd=tmp_path,
        env=environment(tmp_path),
        check=True,
        capture_output=True,
        text=True,
    )
    assert result.stdout.splitlines()[-1].startswith("complete ")


def test_the_installation_without_extras_starts_the_programs_that_it_names() -> None:
    (names,) = re.findall(r"start without `\[tools\]`: ([^.]*)\.", START)
    named = set(re.findall(r"`([\w-]+)`", names))
    run = [sys.executable, "-c", BARE]
    printed = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True).stderr
    for name in PROGRAMS:
        is_started = f"{name} 0\n" in printed
        says_what_it_needs = f"{name}: error: " in printed and f"{name} 2\n" in printed
        assert is_started if name in named else is_started or says_what_it_needs
    assert named <= set(PROGRAMS)
    assert "Traceback" not in printed


@pytest.mark.skipif(os.name != "posix", reason="ends programs with SIGINT")
def test_the_three_terminals_run_and_end_in_order(tmp_path: Path) -> None:
    bus, plant, controller = block_with("steer-by-wire bus").splitlines()
    # So that it depends neither on what the host grants nor on how busy it is.
    further = [*ORDINARY, *UNSUPERVISED]
    with ExitStack() as stack:
        running = []
        for line, options, sign in (
            (bus, [], "listening at"),
            (plant, further, "ready on"),
            (controller, further, "ready on"),
        ):
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "steer_by_wire", *shlex.split(line)[1:], *options],
                    cwd=tmp_path,
                    env=environment(tmp_path),
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    text=True,
                )
            )
            stack.callback(process.kill)
            running.append(process)
            assert process.stdout is not None
            assert sign in process.stdout.readline()
        for process in reversed(running):
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE_S) == 0


def test_the_test_on_the_first_page_passes_when_it_is_pasted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = (block for block in blocks_of(README) if block.language == "python")
    file = tmp_path / block.file
    file.write_text(block.text, encoding="utf-8")
    assert pytest.main([str(file), "--rootdir", str(tmp_path), *RIG_ALONE]) == 0
    assert "3 passed" in capsys.readouterr().out


def test_the_first_page_is_short() -> None:
    assert len(README.split()) <= 450


def run_of(plant: str, law: str, speed_km_h: str, delay_ms: str) -> Run:
    """Return the run over a bus, as the command ``run`` has it."""
    speed = {"plant.vehicle.speed_m_s": float(speed_km_h) / 3.6}
    delay_s = 1e-3 * float(delay_ms)
    return simulate(plant, law, latency_s=delay_s, duration_s=20.0, overrides=speed, bus={})


def test_the_moving_picture_shows_what_is_said_of_it() -> None:
    (within_mm,) = re.findall(r"stays within (\d+) mm", README)
    plant = moving_plant()
    assert f"At {3.6 * plant.vehicle.speed_m_s:.0f} km/h, commands" in README
    runs = [simulate(plant, law, engine="compiled") for law in LAWS]
    pd_m, predictor_m = (abs(run.plant.cg_deviation_m).max() for run in runs)
    assert pd_m > IN_LANE_M
    assert predictor_m == pytest.approx(1e-3 * float(within_mm), abs=1e-3)


def test_the_errors_at_speed_are_those_of_runs() -> None:
    ((speed, plant, law, rms, at, lost, other, rms_2, rms_3, at_3),) = re.findall(
        r"At (\d+) km/h in a double lane change \(`(\w+)`\), `(\w+)` is (\d+) mm off at\s(\d+) ms"
        r" and out of its lane at (\d+) ms; `(\w+)` is (\d+) mm off, and (\d+) mm at (\d+) ms",
        README,
    )
    for preset, delay, wanted_mm in ((law, at, rms), (other, at, rms_2), (other, at_3, rms_3)):
        run = run_of(plant, preset, speed, delay)
        assert f"{1e3 * run.settled_rms_m:.0f}" == wanted_mm
    assert abs(run_of(plant, law, speed, lost).plant.cg_deviation_m).max() > IN_LANE_M
