"""Channels: spikes, gaps, clocks, and columns of tables."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.identification.columns import proposed_mapping, read_columns
from steer_by_wire.closed_loop.identification.time_series import (
    Channel,
    Quantity,
    continuous,
    evened,
    make_drive,
    without_repeats,
    without_spikes,
)
from steer_by_wire.runtime.settings import SettingsError

TIME_S = np.arange(0.0, 30.0, 0.01)


def channel(quantity: Quantity, values, time_s=TIME_S) -> Channel:
    return Channel(str(quantity), quantity, time_s, values)


def channels(wheel_rad: float = 0.3) -> list[Channel]:
    wave = np.sin(2.0 * np.pi * 0.5 * TIME_S)
    return [
        channel(Quantity.HAND_WHEEL, wheel_rad * wave),
        channel(Quantity.SPEED, np.full_like(TIME_S, 15.0)),
        channel(Quantity.YAW_RATE, 0.2 * wave),
    ]


def test_spikes_are_left_out_and_steps_are_not() -> None:
    values = np.where(TIME_S > 10.0, 0.4, 0.0)
    spiked = values.copy()
    spiked[[100, 101, 2000]] += 5.0
    clean, count = without_spikes(channel(Quantity.YAW_RATE, spiked))
    assert count == 3
    assert np.array_equal(np.unique(clean.values), [0.0, 0.4])
    assert without_spikes(channel(Quantity.YAW_RATE, values))[1] == 0


def test_a_gap_and_a_stop_end_a_segment() -> None:
    speed = np.where((TIME_S > 20.0) & (TIME_S < 21.0), 0.0, 15.0)
    hand_wheel, _, rate = channels()
    there = (TIME_S < 8.0) | (TIME_S > 9.0)
    gappy = rate._replace(time_s=TIME_S[there], values=rate.values[there])
    drive = make_drive([hand_wheel, channel(Quantity.SPEED, speed), gappy], "log")
    assert np.ravel(drive.segments) == pytest.approx([0.0, 8.0, 9.0, 20.0, 21.0, 29.99], abs=0.03)


def test_a_clock_that_is_set_back_leaves_a_silence() -> None:
    steps = np.diff(continuous(np.concatenate((TIME_S, TIME_S + 5.0))))
    assert steps.min() > 0.0
    assert (steps > 0.3).sum() == 1


@pytest.mark.parametrize(("share_lost", "error_s"), [(0.0, 5e-5), (0.03, 4e-4)])
def test_jitter_and_losses_leave_even_times(share_lost, error_s) -> None:
    rng, sensed_s = np.random.default_rng(1), np.arange(0.0, 150.0, 0.0099985)
    late_s = rng.gamma(2.0, 0.0015, len(sensed_s))
    there = rng.uniform(size=len(sensed_s)) >= share_lost
    came_s = np.maximum.accumulate(sensed_s + late_s + 1e-9 * np.arange(len(late_s)))[there]
    wave = channel(Quantity.YAW_RATE, np.sin(9.0 * sensed_s)[there], came_s)
    even, jitter_s = evened(wave, 0.01)
    assert jitter_s == pytest.approx(late_s.std(), rel=0.1)
    assert np.std(even.time_s - sensed_s[there]) < error_s


@pytest.mark.parametrize(("period_s", "phases"), [(0.05, 1), (0.025, 2)])
@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_rows_that_repeat_a_sample_are_none_of_their_own(period_s, phases, lost) -> None:
    there = np.random.default_rng(1).uniform(size=len(TIME_S)) >= lost
    time_s = TIME_S[there & (TIME_S // 1.0 != 15.0)]
    sensed_s = np.floor(time_s / period_s + 1e-9) * period_s
    wave = channel(Quantity.YAW_RATE, np.round(np.sin(2.0 * np.pi * sensed_s), 3), time_s)
    kept, found_s = without_repeats(wave)
    assert found_s == pytest.approx(period_s, rel=0.01)
    assert kept.unsure_s == pytest.approx(0.01 / np.sqrt(12.0) / phases)
    late_s = kept.time_s - sensed_s[np.searchsorted(time_s, kept.time_s)]
    assert late_s.max() < 0.01
    drive = make_drive([*channels()[:2], wave], "log")
    assert f"a sample in {1e3 * period_s:.0f} ms" in drive.notes[0]


def test_a_sensor_of_each_row_is_none_that_repeats_its_samples() -> None:
    coarse = np.round(0.3 * np.sin(TIME_S) / 0.002) * 0.002
    for values in (coarse, np.round(channels()[2].values, 3), TIME_S // 10.0):
        wave = channel(Quantity.YAW_RATE, values)
        assert without_repeats(wave) == (wave, 0.0)


def test_times_that_are_uneven_in_truth_are_kept() -> None:
    uneven_s = np.sort(TIME_S + np.random.default_rng(1).uniform(0.0, 0.005, len(TIME_S)))
    wave = channel(Quantity.YAW_RATE, np.sin(2.0 * np.pi * 1.5 * uneven_s), uneven_s)
    assert evened(wave, 0.01) == (wave, 0.0)


def test_a_log_without_motion_or_a_yaw_rate_is_refused_by_name() -> None:
    wheel, *others = channels()
    for still in (channels(1e-4)[0], wheel._replace(values=wheel.values * (TIME_S < 0.9))):
        with pytest.raises(SettingsError, match=r"hand_wheel_rad hardly changes.*drive a sweep"):
            make_drive([still, *others], "log")
    with pytest.raises(SettingsError, match="has no yaw_rate_rad_s"):
        make_drive(channels()[:2], "log")


def test_columns_are_read_in_the_units_of_their_names(tmp_path) -> None:
    file = tmp_path / "log.csv"
    beyond_any_car = "1e300,36,0,0\n20,1e300,,0\n"
    file.write_text(f"time_ms,speed_km_h,yaw_rate_deg_s,x\n0,36,90,1\n10,72,,2\n{beyond_any_car}")
    speed, rate = read_columns(file)
    assert speed.values == pytest.approx([10.0, 20.0])
    assert speed.time_s == pytest.approx([0.0, 0.01])
    assert rate.values == pytest.approx([np.pi / 2.0])


@pytest.mark.parametrize(
    ("read", "text", "what"),
    [
        (proposed_mapping, "", "is empty"),
        (read_columns, "time_s,yaw_rate_rad_s\n", "has no row below its heading"),
        (read_columns, "time_s,speed_m_s\n5,1\n5,2\n", "do not rise"),
        (read_columns, "time_s,speed_m_s,speed_m_s\n5,1,2\n6,2,3\n", "two columns speed_m_s"),
    ],
)
def test_a_table_that_tells_nothing_is_refused(tmp_path, read, text, what) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(SettingsError, match=what):
        read(tmp_path / "log.csv")


@pytest.mark.parametrize(
    ("line", "what"),
    [("unit = 'furlong'", "allowed is rad, deg, mrad"), ("unit = 'rad'\ncolumn = 'x'", "has no")],
)
def test_a_wrong_mapping_is_refused_in_one_line(tmp_path, line, what) -> None:
    file, mapping = tmp_path / "log.csv", tmp_path / "map.toml"
    file.write_text("time_s,a\n0,1\n")
    column = "" if "column" in line else "column = 'a'\n"
    mapping.write_text(
        "[columns.time_s]\ncolumn = 'time_s'\nunit = 's'\n"
        f"[columns.hand_wheel_rad]\n{column}{line}\n"
    )
    with pytest.raises(SettingsError, match=what):
        read_columns(file, mapping)
