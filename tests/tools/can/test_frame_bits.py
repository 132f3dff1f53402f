"""The program ``steer-by-wire can bits``."""

import json

import pytest

from steer_by_wire.tools.can.__main__ import main


def test_a_frame_is_shown_field_by_field(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bits", "100#00"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["SOF", "0"]
    assert lines[1].split() == ["ID", "00100000[1]000"]
    assert lines[-1].endswith("µs")


def test_its_json_has_the_bits_that_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    frame = "123##1DEADBEEF"
    assert main(["bits", frame]) == 0
    *fields, total = capsys.readouterr().out.splitlines()
    assert main(["bits", frame, "--json", "-"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert [line.split() for line in fields] == [
        [*one["field"].split(), one["bits"]] for one in figures["fields"]
    ]
    levels = "".join(one["bits"] for one in figures["fields"])
    assert levels.count("0") + levels.count("1") == figures["bits"]
    assert levels.count("[") == figures["stuff_bits"]
    assert total.startswith(f"{figures['bits']} bits ({figures['bits_at_data_rate']} at the data")
    assert total.endswith(f": {1e6 * figures['duration_s']:g} µs")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["hello"], "no frame; one is"),
        (["100#R00"], "no frame; one is"),
        (["100##1001122334455667788"], "no frame; one is"),
        (["100#R8"], "DLC of 0 here, FD frames no ESI: 100#R"),
        (["100##3AA"], "DLC of 0 here, FD frames no ESI: 100##1AA"),
        ([__file__], "no frame; one is"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bits", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
