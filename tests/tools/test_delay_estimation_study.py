"""The study of the delay's estimate: the names its command line takes, and what it shows."""

import pytest

from steer_by_wire.tools.delay_estimation_study.__main__ import _parser, shown
from steer_by_wire.tools.delay_estimation_study.runs import (
    CORNERS,
    DISTURBANCES,
    LAWS,
    NETWORKS,
    NO_DISTURBANCE,
    PATHS,
    cases,
    run_case,
)


def test_a_name_is_one_word_and_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _parser().parse_args(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    words = ("ellipse_60_x_30_m", "2_x_80_30_ms", "80_ms", "pd_ddob")
    assert all(f" {word}" in text for word in words)
    options = _parser().parse_args(["--paths", words[0], "--networks", words[1], words[2]])
    assert (options.paths, options.networks) == (
        ["ellipse 60 x 30 m"],
        ["2 x 80 ± 30 ms", "80 ms"],
    )
    assert (options.corners, options.disturbances) == (tuple(CORNERS), (NO_DISTURBANCE,))


def test_each_disturbance_acts_in_its_runs() -> None:
    names = ("steering offset", "side force")
    assert set(names) | {NO_DISTURBANCE} == set(DISTURBANCES)
    offset, force = (
        run_case(case)[0]
        for case in cases(["pd"], ["double lane change"], ["80 ms"], ["a"], names)
        if not case.noise_m
    )
    assert offset.observable_share < 0.1 < 0.5 < force.observable_share


def test_a_name_that_is_none_is_refused_with_those_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        _parser().parse_args(["--corners", "e"])
    assert capsys.readouterr().err.splitlines()[-1].endswith("'e' is none of a, b, c, d")


def test_the_picture_shows_what_was_selected() -> None:
    chosen = cases(["pd"], ["double lane change"], ["250 ms", "400 ms"], ["a", "b"])
    assert [[(case.law, case.network, case.corner) for case in row] for row in shown(chosen)] == [
        [("pd", "250 ms", "a")]
    ]
    other = cases(["predictor"], ["default ellipse"], ["400 ms"], ["c"])
    assert shown(other) == [[other[0]]]
    disturbed = cases(["pd"], ["double lane change"], ["250 ms"], ["a"], ["side force"])
    assert [[case.disturbance for case in row] for row in shown(disturbed)] == [["side force"]]


def test_the_picture_of_the_whole_study_has_nine_panels_of_one_law() -> None:
    rows = shown(cases(LAWS, tuple(PATHS), tuple(NETWORKS), tuple(CORNERS)))
    assert [len(row) for row in rows] == [3, 3, 3]
    assert {case.law for row in rows for case in row} == {"pd_ddob"}
