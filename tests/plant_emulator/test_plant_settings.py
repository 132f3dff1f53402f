"""Settings of the plant emulator: presets, defaults, and messages about mistakes."""

from pathlib import Path

import pytest

from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.settings import (
    Preset,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)
from steer_by_wire.runtime.settings.toml_text import dump_toml


def mistake(text: str, tmp_path: Path) -> str:
    """Return the error message for a settings file; it has to be one line."""
    file = tmp_path / "plant.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as caught:
        load_settings(PlantSettings, file=file)
    (line,) = caught.value.mistakes
    assert "\n" not in line
    return line


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_every_preset_loads_and_runs(name: str) -> None:
    settings = load_settings(PlantSettings, read_preset(PRESETS, name))
    node = PlantNode(settings, 0)
    assert len(node.on_tick(0)) == 4


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_every_preset_survives_being_written_and_read(name: str) -> None:
    settings = load_settings(PlantSettings, read_preset(PRESETS, name))
    assert load_settings(PlantSettings, Preset("again", dump_toml(settings))) == settings


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("seed = -1", ["seed = -1", "from 0, up to 9223372036854775807"]),
        ("[latency.uplink]\nspread_s = 0.1", ["latency.uplink", "spread_s needs a model"]),
        (
            "[latency.uplink]\nschedule = [{time_s = 2, mean_s = 0}, {time_s = 1, mean_s = 0}]",
            ["latency.uplink", "schedule must rise in time: 1.0 s follows 2.0 s"],
        ),
        (
            "[latency.uplink]\nschedule = [{time_s = 2, mean_s = 11}]",
            ["latency.uplink.schedule", "mean_s = 11", "10"],
        ),
        (
            "[latency.uplink]\ntrace_file = 'no/such.csv'",
            ["latency.uplink", "no/such.csv: cannot be read: No such file"],
        ),
    ],
)
def test_a_bad_setting_is_one_line_naming_file_key_value_and_range(
    tmp_path: Path, text: str, parts: list[str]
) -> None:
    line = mistake(text, tmp_path)
    assert [part for part in [str(tmp_path / "plant.toml"), *parts] if part not in line] == []


def test_a_schedule_and_a_trace_exclude_each_other(tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text("latency_s\n0\n")
    line = mistake(
        f"[latency.uplink]\ntrace_file = '{trace}'\nschedule = [{{time_s = 0, mean_s = 0}}]",
        tmp_path,
    )
    assert "schedule and trace_file exclude each other" in line
