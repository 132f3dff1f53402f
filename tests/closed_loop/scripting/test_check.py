"""``check`` of the library: the figures of the command, by the names a user asks for."""

import json

import numpy as np
import pytest

from steer_by_wire import SettingsError, check
from steer_by_wire.controller.command_line.program import check_main
from tests.support.suite.no_jitter import no_jitter as no_jitter

pytestmark = pytest.mark.usefixtures("no_jitter")


def test_the_library_says_what_the_command_says(capsys: pytest.CaptureFixture[str]) -> None:
    checked = check("practical_pd", overrides={"rate_hz": 50})
    assert check_main(["--preset", "practical_pd", "--rate-hz", "50", "--json", "-"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (checked.verdict, checked.reason) == (printed["verdict"], printed["reason"])
    assert checked.delay_margin_s == printed["delay_margin_s"]
    assert [list(each) for each in checked.stable_delays_s] == (
        printed["analysis"]["stable_delays"]["intervals_s"]
    )
    margins = checked.margins
    assert margins is not None
    assert margins.gain_max == printed["analysis"]["margins"]["gain_max"]
    assert f"{checked.verdict}: {checked.reason}" in repr(checked)


def test_a_loop_that_is_not_stable_has_no_margins_and_no_stable_delays() -> None:
    checked = check("practical_pd", overrides={"pd.proportional_gain_rad_m": 500.0})
    assert (checked.verdict, checked.delay_margin_s) == ("not stable", 0.0)
    assert checked.margins is None
    assert checked.stable_delays_s == []


def test_an_unknown_law_is_refused_in_one_line() -> None:
    with pytest.raises(SettingsError, match=r"overrides of controller: law = \"pdd\" [^\n]*$"):
        check(law="pdd")


@pytest.mark.parametrize("delay_s", [0.0, 0.1])
def test_the_margins_are_those_of_the_loop_response(delay_s: float) -> None:
    checked = check("practical_pd")
    margins = checked.margins
    assert margins is not None
    response = checked.loop_response(np.array([margins.crossover_rad_s]), delay_s)
    assert abs(response[0]) == pytest.approx(1.0)
    lag_rad = delay_s * margins.crossover_rad_s
    assert np.angle(-response[0]) == pytest.approx(margins.phase_rad - lag_rad)


def test_a_law_that_looks_back_has_no_one_frequency_response() -> None:
    brief = {"predictor.horizon_s_max": 0.1}  # less to search through
    checked = check("practical_predictor", overrides=brief)
    with pytest.raises(ValueError, match=r"^law predictor: a loop has one frequency response only"):
        checked.loop_response(np.array([1.0]))
    nyquist = np.logspace(0.0, np.log10(50.0 * np.pi))  # its end is rounded up
    assert check("practical_pd", overrides={"rate_hz": 50.0}).loop_response(nyquist).all()
    for omega_rad_s, delay_s in ((0.0, 0.0), (400.0, 0.0), (1.0, -0.1), (np.nan, 0.0)):
        with pytest.raises(ValueError, match="omega_rad_s: above 0, up to 314"):
            check("practical_pd").loop_response(np.array([omega_rad_s]), delay_s)
