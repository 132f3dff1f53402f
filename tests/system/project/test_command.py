"""The one command: its help on the programs, that its examples work, and its other names."""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import metadata, requires
from pathlib import Path
from types import SimpleNamespace

import pytest

import steer_by_wire
from steer_by_wire import command
from steer_by_wire.command import PROGRAMS, main
from steer_by_wire.runtime.command_line import DISTRIBUTION, installation
from tests.support.programs.running_program import PATIENCE_S
from tests.support.suite.no_jitter import no_jitter as no_jitter
from tests.support.suite.unrendered import unrendered as unrendered

ROOT = Path(__file__).resolve().parents[3]
SCREEN_LINES = 40
LONG = {"plant", "controller", "run", "cockpit"}
"""They show the options of both the program and the bus."""
LONG_LINES = 60
CHEAP = ("analyze", "study", "check")
"""Whose examples are run as they are printed; that of analyze begins with that of run."""

SUBCOMMANDS = [f"{name} {sub}" for name, it in PROGRAMS.items() for sub in it.subcommands]

Help = Callable[[str], str]


@pytest.fixture
def help_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Help:
    """What ``steer-by-wire NAME --help`` prints, 100 columns wide."""
    monkeypatch.setenv("COLUMNS", "100")

    def read(name: str) -> str:
        with pytest.raises(SystemExit) as end:
            main([*name.split(), "--help"])
        assert end.value.code == 0
        return capsys.readouterr().out

    return read


def examples(text: str) -> list[list[str]]:
    """Return the commands at the end of a program's help, from the name of the program on."""
    _, _, after = text.partition("\nexample:\n")
    commands = [shlex.split(line) for line in after.splitlines()]
    return [words[words[0] == command.NAME :] for words in commands]


@pytest.mark.parametrize("name", [*PROGRAMS, *SUBCOMMANDS])
def test_the_help_of_a_program_is_one_screen_that_ends_with_examples(
    name: str, help_of: Help, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = help_of(name)
    assert text.startswith(f"usage: steer-by-wire {name} ") or name == "with-vcan"
    lines = text.splitlines()
    assert len(lines) <= (LONG_LINES if name in LONG else SCREEN_LINES)
    assert max(map(len, lines)) <= 100
    commands = examples(text)
    assert " ".join(commands[-1]).startswith(name)
    parse_args = argparse.ArgumentParser.parse_args

    def only_parse(parser: argparse.ArgumentParser, words: list[str]) -> None:
        parse_args(parser, words)
        raise SystemExit(0)

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", only_parse)
    for words in commands:
        with pytest.raises(SystemExit) as end:
            main(words)
        assert end.value.code == 0


@pytest.mark.usefixtures("unrendered", "no_jitter")
@pytest.mark.parametrize("name", CHEAP)
def test_an_example_works_as_it_is_printed(
    name: str, help_of: Help, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for words in examples(help_of(name)):
        assert main(words) == 0


def test_the_command_lists_every_program_on_one_screen(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(re.search(rf"^  {name} ", text, re.MULTILINE) for name in PROGRAMS)
    assert len(text.splitlines()) <= SCREEN_LINES
    assert max(map(len, text.splitlines())) <= 80


def test_help_of_a_name_is_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["help", "check"])
    assert capsys.readouterr().out.startswith("usage: steer-by-wire check ")


def test_the_version_is_the_distributions_and_the_packages(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--version"]) == 0
    assert metadata(DISTRIBUTION)["Version"] == steer_by_wire.__version__
    assert capsys.readouterr().out == f"steer-by-wire {steer_by_wire.__version__}\n"


GIT = {"vcs": "git", "commit_id": "1f"}
TAG = GIT | {"requested_revision": "v2"}


@pytest.mark.parametrize(
    ("origin", "library", "reported"),
    [
        ({"dir_info": {}, "url": "file:///a%20b"}, "rich", "'/a b[tools]'"),
        ({"dir_info": {"editable": True}, "url": "file:///a"}, "distributed", "-e '/a[studies]'"),
        ({"dir_info": {}, "url": "file:///a"}, "numpy", "'/a'"),
        ({"dir_info": {}, "url": "file:///a"}, "e2e", "'/a'"),
        ({"archive_info": {}, "url": "file:///a.whl"}, "rich", f"'{DISTRIBUTION}[tools] @ file:///a.whl'"),
        ({"vcs_info": GIT, "url": "https://x"}, "rich", f"'{DISTRIBUTION}[tools] @ git+https://x@1f'"),
        (
            {"vcs_info": TAG, "url": "https://x", "subdirectory": "a"},
            "rich", f"'{DISTRIBUTION}[tools] @ git+https://x@v2#subdirectory=a'",
        ),
        (None, "rich", f"'{DISTRIBUTION}[tools]'"),
    ],
)  # fmt: skip
def test_what_installs_a_library_comes_from_where_this_was_installed(
    monkeypatch: pytest.MonkeyPatch, origin: object, library: str, reported: str
) -> None:
    records = {"direct_url.json": json.dumps(origin)} if origin else {}
    installed = SimpleNamespace(read_text=records.get, requires=requires(DISTRIBUTION))
    monkeypatch.setattr("importlib.metadata.distributions", lambda name: [installed])  # noqa: ARG005
    assert installation(library) == f"pip install {reported}"


def test_every_extra_that_is_named_anywhere_exists() -> None:
    """In pip's brackets or in words; and only a release is installed by its name from an index."""
    known = set(metadata(DISTRIBUTION).get_all("Provides-Extra") or ())
    folders = (
        *("closed_loop", "controller", "dbc", "docs", "examples", "plant_emulator", "runtime"),
        *("steer_by_wire", "tests", "tools"),
    )
    files = [ROOT / "README.md"]
    files += [f for name in folders for f in (ROOT / name).rglob("*") if f.suffix in (".md", ".py")]
    named: dict[str, str] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert not re.search(rf"{DISTRIBUTION}\[[^]]*\](?! @ |==)", text), file
        for extras in re.findall(rf"(?:'\.|{DISTRIBUTION})\[([a-z0-9,_-]+)\](?:'| @ )", text):
            named |= dict.fromkeys(extras.split(","), file.name)
        named |= dict.fromkeys(re.findall(r"\bextra `?([a-z0-9]+)[`)]", text), file.name)
    assert len(named) > 4
    assert not {extra: file for extra, file in named.items() if extra not in known}


def test_a_missing_library_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(_name: str) -> None:
        raise ModuleNotFoundError("No module named 'matplotlib.figure'", name="matplotlib.figure")

    monkeypatch.setattr("steer_by_wire.runtime.command_line.importlib.import_module", missing)
    assert main(["demo"]) == 2
    assert capsys.readouterr().err == (
        f"steer-by-wire demo: error: matplotlib is not installed: {installation('rich')}\n"
    )


def completions(line: str, tmp_path: Path) -> set[str]:
    """Return what a shell is offered at the end of ``line``, by argcomplete's protocol."""
    answer = tmp_path / "answer"
    subprocess.run(
        [sys.executable, "-m", "steer_by_wire"],
        env={
            **os.environ,
            "_ARGCOMPLETE": "1",
            "_ARGCOMPLETE_IFS": "\n",
            "XDG_CACHE_HOME": str(tmp_path / "cache"),
            "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
            "COMP_LINE": line,
            "COMP_POINT": str(len(line)),
            "COMP_TYPE": "9",
        },
        check=True,
        timeout=PATIENCE_S,
    )
    return set(answer.read_text(encoding="utf-8").split())


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("steer-by-wire stu", {"study"}),
        ("steer-by-wire check --p", {"--preset"}),
        ("steer-by-wire bus --", {"--address", "--bitrate"}),
        ("steer-by-wire run --preset pap", {"paper_nominal", "paper_pd"}),
        ("steer-by-wire run --set plant.latency.up", {"plant.latency.uplink.mean_s="}),
        ("steer-by-wire controller --law pd_", {"pd_dob", "pd_cdob", "pd_ddob"}),
        (
            "steer-by-wire run --set plant.latency.uplink.model=g",
            {"plant.latency.uplink.model=gamma"},
        ),
        ("steer-by-wire plant --fail-if set", {"settled_rms_m"}),
        ("steer-by-wire study com", {"compare", "compare_at_speed"}),
        ("steer-by-wire cockpit --bus e", {"emulated"}),
        ("steer-by-wire can response-times --b", {"--bitrate"}),
    ],
)
def test_a_shell_is_offered_programs_options_and_values(
    line: str, offered: set[str], tmp_path: Path
) -> None:
    first = completions(line, tmp_path)
    assert offered <= first
    if line.count(" ") > 1:
        kept = list((tmp_path / "cache").rglob("*.json"))
        assert len(kept) == 1
        assert completions(line, tmp_path) == first  # now without importing the program


@pytest.mark.parametrize("shell", command.SHELLS)
def test_the_script_for_a_shell_names_the_command(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--completion", shell]) == 0
    assert "steer-by-wire" in capsys.readouterr().out


def test_a_script_that_nobody_reads_to_its_end_is_no_mistake() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as unread:
        done = subprocess.run(
            [sys.executable, "-m", "steer_by_wire", "--completion", "bash"],
            cwd=ROOT, stdout=unread, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("kilobytes", [150_000, 250_000])
def test_too_little_memory_ends_in_a_line(kilobytes: int) -> None:
    own = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    words = f"{sys.executable} -m steer_by_wire run --duration 0.1"
    limited = ["sh", "-c", f"ulimit -v {kilobytes}; exec {words}"]
    done = subprocess.run(
        limited, cwd=ROOT, env=own, timeout=PATIENCE_S, text=True, capture_output=True
    )
    assert done.returncode in (0, 2)
    assert done.returncode == 0 or len(done.stderr.splitlines()) == 1
