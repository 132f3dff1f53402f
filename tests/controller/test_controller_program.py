"""The program ``steer-by-wire controller``: its settings, ``--check`` and errors."""

import json
import tomllib
from pathlib import Path

import pytest

from steer_by_wire.controller.analysis import check_figures, jitter
from steer_by_wire.controller.analysis.check_in_words import check_text
from steer_by_wire.controller.command_line import program
from steer_by_wire.controller.command_line.program import check_main, main
from steer_by_wire.controller.node.modes import supervision_of
from steer_by_wire.controller.settings import PRESETS, ControllerSettings
from steer_by_wire.dbc.messages import SteeringCommand, limits
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import load_settings, preset_names, read_preset
from tests.support.suite.no_jitter import no_jitter as no_jitter

Capture = pytest.CaptureFixture[str]
MINIMAL = """
law = "pd"

[pd]
proportional_gain_rad_m = 1.0
derivative_gain_rad_s_m = 0.1
derivative_filter_rad_s = 10.0
"""
NOT_ANALYSED = {"rate_hz": 100.0, "period_s": 0.01, "not_analysed": "of a test"}
NOT_ANALYSED |= {"judged_on": None, "corners": []}
"""Figures of a test to which the analysis itself says nothing."""


def preset(name: str, *overrides: str) -> ControllerSettings:
    return load_settings(ControllerSettings, read_preset(PRESETS, name), overrides=overrides)


def checked(capsys: Capture, *arguments: str) -> str:
    assert main([*arguments, "--check"]) == ExitStatus.OK
    return capsys.readouterr().out


# Settings


def test_the_angle_limit_may_reach_what_the_signal_carries() -> None:
    reach_rad = limits(SteeringCommand)["steer_rad"].maximum
    settings = preset("practical_pd", f"limits.steer_rad_max={reach_rad}")
    assert settings.limits.steer_rad_max == reach_rad


def test_what_users_set_in_milliseconds_and_per_second_the_steps_get_per_period() -> None:
    settings = preset(
        "practical_pd",
        "rate_hz=200",
        "limits.steer_rate_rad_s_max=0.5",
        "supervision.measurement_timeout_ms=12.5",
    )
    assert settings.steer_limits.step_rad_max == pytest.approx(0.0025)
    assert supervision_of(settings).measurement_timeout_ns == 12_500_000


# --check


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_what_check_prints_is_a_settings_file_with_the_settings_in_effect(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # At 1 kHz there is no analysis of jitter, and at 64 Hz it takes half the time of 100 Hz. What
    # looks back is analysed over a common multiple with the sensors' 10 ms instead, at few delays.
    monkeypatch.setattr(check_figures, "DELAY_NS_MAX", 20_000_000)
    monkeypatch.setattr(check_figures, "SHOWN_DELAYS_MS", (0,))
    monkeypatch.setattr(jitter, "MEANS_MS", (80,))
    looks_back = preset(name).law in ("predictor", "packet", "mpc")
    rates = ("rate_hz=100",) if looks_back else ("rate_hz=64", "link.sensor_period_ms=15.625")
    settings = preset(name, *rates)
    is_first = name == next(
        each for each in preset_names(PRESETS) if preset(each).law == settings.law
    )
    text = check_text(settings, None if is_first else NOT_ANALYSED)
    assert ControllerSettings.model_validate(tomllib.loads(text)) == settings
    assert all(line == line.rstrip() for line in text.splitlines())
    assert all(len(line) <= 100 for line in text.splitlines() if line.startswith("#"))
    if not is_first:  # one of each law is analysed
        return
    assert "# Poles of the closed loop around the nominal plant, without delay:" in text
    assert "#   delay margin  " in text
    if looks_back:
        assert "# Latency that varies is for simulation: steer-by-wire study." in text
    else:
        assert "# Poles of the law alone:" in text
        assert ("#   stable at     no delay" in text) != ("#   mean  80 ms   " in text)


def test_check_prints_json_with_the_figures_of_the_text(capsys: Capture) -> None:
    assert check_main(["--preset", "paper_pd", "--json", "-"]) == ExitStatus.OK
    written = capsys.readouterr()
    assert all(line.endswith(" ...") for line in written.err.splitlines())
    assert "computing poles and margins ..." in written.err
    printed = json.loads(written.out)
    assert ControllerSettings.model_validate(printed["settings"]) == preset("paper_pd")
    assert printed["verdict"] == "stable"
    assert printed["reason"].startswith("around the nominal plant, up to a delay of 9.2")
    assert printed["delay_margin_s"] == printed["analysis"]["stable_delays"]["margin_s"]
    analysis = printed["analysis"]
    assert (analysis["law"], analysis["rate_hz"], analysis["period_s"]) == ("pd", 1000.0, 0.001)
    assert analysis["stable_delays"]["margin_s"] == pytest.approx(0.00923, abs=1e-5)
    assert analysis["stable_delays"]["intervals_s"][0][0] == 0.0
    assert analysis["margins"]["gain_max"] > 1.0
    assert analysis["closed_loop_poles"][0]["modulus"] < 1.0
    assert [at["mean_s"] for at in analysis["jitter"]] == [0.08, 0.16]


@pytest.mark.parametrize(
    ("arguments", "has_table"),
    [
        (["--preset", "practical_pd"], False),
        (["--preset", "practical_pd", "--set", "estimator.actuator_lag_s=0.1"], True),
    ],
)
def test_check_shows_the_estimator_only_where_it_is_read_or_was_set(
    arguments: list[str], has_table: bool, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(program, "check_figures", lambda *_: NOT_ANALYSED)
    assert ("[estimator]" in checked(capsys, *arguments)) is has_table


def test_check_says_how_much_delay_the_published_gains_tolerate(capsys: Capture) -> None:
    out = checked(capsys, "--preset", "paper_pd")
    assert "# Runs at 1000 Hz, every 1000000 ns." in out
    assert "#   delay margin  9.23 ms" in out
    assert "#   stable at     0.00 to 9.23 ms\n" in out
    assert "too many commands on their way" in out


def test_check_says_that_the_published_cdob_drifts(capsys: Capture) -> None:
    out = checked(capsys, "--preset", "paper_pd_cdob", "--rate-hz", "200")
    assert "# NOT STABLE, even without delay:" in out
    assert "the vehicle drifts" in out
    assert "#   stable at     no delay" in out


@pytest.mark.usefixtures("no_jitter")
def test_check_shows_a_set_of_stable_delays_with_a_gap(capsys: Capture) -> None:
    gap = ("pd.derivative_filter_rad_s=20", "cdob.q_cutoff_rad_s=50", "cdob.washout_rad_s=3")
    gains = ("pd.proportional_gain_rad_m=1.0596", "pd.derivative_gain_rad_s_m=0.939")
    box = ("validity.delay_ms_max=150",)
    options = [word for setting in (*gap, *gains, *box) for word in ("--set", setting)]
    out = checked(capsys, "--preset", "practical_pd_cdob", *options)
    assert "#   stable at     0.00 to 41.34 ms, 105.10 to 177.20 ms, 310.49 to 314.05 ms\n" in out
    # 150 ms is stable around the nominal plant, but not all delays up to it.
    verdict = out.splitlines()[0]
    assert verdict.startswith(
        "# verdict: not stable: at speed_m_s = 1.944, virtual_mass_kg = 1600, above "
    )
    assert verdict.endswith(" ms, while [validity] declares 150 ms")


@pytest.mark.usefixtures("no_jitter")
def test_check_says_that_a_loop_grows(capsys: Capture) -> None:
    out = checked(capsys, "--preset", "practical_pd", "--set", "pd.derivative_gain_rad_s_m=20")
    assert "# NOT STABLE, even without delay:\n#   its slowest mode grows at" in out
    assert "#   delay margin  none" in out


def test_check_without_a_model_shows_the_law_and_says_what_is_missing(
    tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "car.toml"
    file.write_text(MINIMAL, encoding="utf-8")
    out = checked(capsys, str(file))
    assert "# There is no [nominal_model], hence no closed loop to analyse." in out


@pytest.mark.usefixtures("no_jitter")
def test_law_and_rate_on_the_command_line_are_on_top_of_all_else(capsys: Capture) -> None:
    short = ("--law", "pd", "--rate-hz", "50")
    out = checked(capsys, "--preset", "practical_pd_ddob", "--set", "rate_hz=20", *short)
    loaded = tomllib.loads(out)
    assert (loaded["law"], loaded["rate_hz"]) == ("pd", 50.0)
