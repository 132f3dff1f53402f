"""``--fail-if``: which conditions are read, which are refused, and which a run meets."""

import argparse
from typing import Any

import pytest

from steer_by_wire.runtime.program.fail_if_conditions import (
    Quantity,
    add_fail_if_argument,
    condition_of,
    failures,
    of_part,
)

QUANTITIES = {
    "rms_m": Quantity(lambda report: report["rms_m"]),
    "verdict": Quantity(lambda report: report["verdict"], ("holds", "off path")),
}


def met(text: str, **report: Any) -> list[str]:
    return failures([condition_of(QUANTITIES)(text)], QUANTITIES, report)


@pytest.mark.parametrize(
    ("text", "is_met"),
    [
        ("rms_m > 0.02", True),
        ("rms_m > 0.03", False),
        ("rms_m>=0.03", True),
        ("rms_m < 3e-2", False),
        (" rms_m <= 0.03 ", True),
        ("rms_m == 0.03", True),
        ("rms_m != 0.03", False),
        ("rms_m > -inf", True),
    ],
)
def test_a_number_is_compared(text: str, is_met: bool) -> None:
    assert bool(met(text, rms_m=0.03)) is is_met


@pytest.mark.parametrize(
    ("text", "is_met"),
    [("verdict != holds", True), ("verdict == off path", True), ("verdict == holds", False)],
)
def test_a_word_is_compared(text: str, is_met: bool) -> None:
    assert bool(met(text, verdict="off path")) is is_met


def test_a_line_names_condition_and_value() -> None:
    assert met("rms_m > 0.02", rms_m=0.0301) == ["failed: rms_m > 0.02: rms_m is 0.0301"]


def test_what_has_no_value_has_failed_whatever_the_condition() -> None:
    for text in ("rms_m > 0.02", "rms_m < 0.02"):
        (line,) = met(text, rms_m=None)
        assert line.endswith("rms_m has no value in this run")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rms_m", "is no NAME < VALUE"),
        ("rms_m => 1", "is no NAME < VALUE|is no number"),
        ("rms > 0.02", "no quantity 'rms': did you mean rms_m?"),
        ("rms_m > much", "'much' is no number"),
        ("rms_m > nan", "'nan' is no number"),
        ("verdict == hold", "with one of holds, off path"),
        ("verdict > holds", "with one of holds, off path"),
        ("", "is no NAME < VALUE"),
    ],
)
def test_a_bad_condition_is_one_line_with_the_allowed_names(
    text: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=expected):
        condition_of(QUANTITIES)(text)
    parser = argparse.ArgumentParser(prog="p", usage="p")
    add_fail_if_argument(parser, QUANTITIES)
    with pytest.raises(SystemExit, match="2"):
        parser.parse_args(["--fail-if", text])
    usage, error, nothing = capsys.readouterr().err.split("\n")
    assert (usage, nothing) == ("usage: p", "")
    assert error.startswith("p: error: argument --fail-if: ")


def test_conditions_add_up_and_help_lists_the_names() -> None:
    parser = argparse.ArgumentParser()
    add_fail_if_argument(parser, QUANTITIES)
    options = parser.parse_args(["--fail-if", "rms_m > 1", "--fail-if", "verdict != holds"])
    report = {"rms_m": 2.0, "verdict": "holds"}
    assert len(options.fail_if) == 2
    assert len(failures(options.fail_if, QUANTITIES, report)) == 1
    assert "rms_m, verdict" in parser.format_help()


def test_a_part_of_a_report_has_its_quantities_under_a_prefix() -> None:
    quantities = of_part(QUANTITIES, "controller", "controller_")
    condition = condition_of(quantities)("controller_rms_m > 1")
    assert failures([condition], quantities, {"controller": {"rms_m": 2.0}})
