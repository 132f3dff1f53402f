"""The standard tests of cars without a driver: a table, a file and a picture."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import LINES, plot_style
from ...closed_loop.studies.vehicle_tests.scores import (
    ASIDE_M_MIN,
    LATER_YAW_SHARE_MAX,
    YAW_SHARE_MAX,
    CarScores,
    scores_of,
)
from ...closed_loop.studies.vehicle_tests.settings import VehicleTestSettings, read_vehicle_tests
from ...plant_emulator.path.drivability import GRAVITY_M_S2
from ...plant_emulator.settings import plant_preset
from .own_kinds import Results

Scores = Mapping[str, CarScores]


def read(file: Path) -> tuple[VehicleTestSettings, str]:
    """Return the settings, and the size of the study; raises SettingsError."""
    settings = read_vehicle_tests(file)
    return settings, f"cars: {len(settings.plants)}"


def results_of(settings: VehicleTestSettings) -> Results:
    """Drive the tests; raises SettingsError."""
    plants = {name: plant_preset(name, settings.plant) for name in settings.plants}
    scores = {name: scores_of(plant, settings) for name, plant in plants.items()}
    rows = [
        (name, test, figure, value)
        for name, car in scores.items()
        for test in ("steady", "step", "sine", "dwell")
        for figure, value in getattr(car, test)._asdict().items()
    ]
    head = "car", "test", "figure", "value"
    return Results(lines_of(settings, scores), [head, *rows], picture_of(scores))


def lines_of(settings: VehicleTestSettings, scores: Scores) -> list[str]:
    """Return a table: a row for each figure, a column for each car."""
    degrees_g = math.degrees(GRAVITY_M_S2)
    rows: dict[str, list[str]] = {}
    for car in scores.values():
        steady, step, sine, dwell = car[:4]
        verdict = "passes" if dwell.fails_from is None else f"fails at {dwell.fails_from:g} A"
        for name, text in {
            f"steady turn at {settings.speed_km_h:g} km/h (ISO 4138)": "",
            "  understeer gradient [deg/g]": f"{steady.understeer_rad_s2_m * degrees_g:.2f}",
            "  largest lateral acceleration [m/s²]": f"{steady.lateral_m_s2_max:.1f}",
            "  axle that slides": steady.slides_first,
            f"step to {settings.lateral_m_s2:g} m/s² (ISO 7401)": "",
            "  steering: half of its step [s]": f"{step.steering_s:.3f}",
            "  yaw rate: response time [s]": f"{step.yaw_response_s:.2f}",
            "  yaw rate: peak time [s]": f"{step.yaw_peak_s:.2f}",
            "  yaw rate: overshoot [%]": f"{100.0 * step.yaw_overshoot:.0f}",
            "  lateral acceleration: response time [s]": f"{step.lateral_response_s:.2f}",
            "  TB [s deg]": f"{math.degrees(step.tb_s_rad):.2f}",
            f"sine of {settings.sine_hz:g} Hz (ISO 7401)": "",
            "  lag of the yaw rate [s]": f"{sine.yaw_lag_s:.2f}",
            "  lag of the lateral acceleration [s]": f"{sine.lateral_lag_s:.2f}",
            "sine with dwell at 80 km/h (FMVSS 126)": verdict,
            f"  yaw rate after 1 s [%], at most {100 * YAW_SHARE_MAX:g}": _percent(dwell.yaw_share),
            f"  after 1.75 s [%], at most {100 * LATER_YAW_SHARE_MAX:g}": _percent(
                dwell.later_yaw_share
            ),
            f"  displacement [m], at least {ASIDE_M_MIN:g}": f"{dwell.aside_m:.2f}",
        }.items():
            rows.setdefault(name, []).append(text)
    width = max(map(len, rows))
    lines = ["", " " * width + "".join(f"{name:>16}" for name in scores)]
    lines += [
        f"{name:<{width}}" + "".join(f"{text:>16}" for text in row) for name, row in rows.items()
    ]
    return [*(line.rstrip() for line in lines), "", "No bus, guard or stability control acts."]


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f}"


def picture_of(scores: Scores) -> Figure:
    """Return steer over lateral acceleration, and the yaw rates of step and sine with dwell."""
    with plot_style():
        figure = Figure(figsize=(11.0, 3.6))
        steady, step, dwell = figure.subplots(1, 3)
        for (name, car), line in zip(scores.items(), LINES * 4, strict=False):
            turn = car.turning
            to_peak = slice(0, int(np.argmax(turn.lateral_m_s2)) + 1)
            steady.plot(
                turn.lateral_m_s2[to_peak], np.degrees(turn.wheel_rad[to_peak]), label=name, **line
            )
            for axes, run in ((step, car.stepping), (dwell, car.dwelling)):
                axes.plot(run.time_s, np.degrees(run.yaw_rate_rad_s), **line)
        steady.set(
            title="steady turn",
            xlabel="lateral acceleration [m/s²]",
            ylabel="steer of the front wheels [deg]",
        )
        step.set(title="step", xlabel="time [s]", ylabel="yaw rate [deg/s]")
        dwell.set(title="sine with dwell, 6.5 A", xlabel="time [s]", ylabel="yaw rate [deg/s]")
        steady.legend(fontsize="x-small")
    return figure
