"""The page of ``steer-by-wire identify``: pictures, intervals, and what to drive next."""

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas
from scipy.signal import coherence, csd

from steer_by_wire.closed_loop.identification.figures import Verdict
from steer_by_wire.closed_loop.identification.identified import Doubt, Identification
from steer_by_wire.closed_loop.identification.response import STEP_S, respond
from steer_by_wire.closed_loop.identification.time_series import Quantity
from steer_by_wire.closed_loop.identification.vehicle_file import shown
from steer_by_wire.closed_loop.reports.page import Cell, Picture, Section, Table, number, page
from steer_by_wire.closed_loop.reports.plot_style import plot_style, png_of
from steer_by_wire.runtime.array_types import FloatArray

_MARKS = {Verdict.IDENTIFIED: "good", Verdict.COMBINATION: "fair", Verdict.NOT_IDENTIFIABLE: "poor"}
_UNITS = {Quantity.YAW_RATE: "rad/s", Quantity.LATERAL_ACCELERATION: "m/s²"}
_UNIT_OF_NAME = re.compile("_(rad_s|deg_s|m_s2|g)$")
_PERIOD_S, _WINDOW_S, _HZ_MAX, _COHERENT = 0.01, 8.0, 4.0, 0.8


def report_html(
    source: str, found: Identification, doubts: Sequence[Doubt], lines: Sequence[str]
) -> str:
    """Return the page; ``lines`` are what is said of delays and of what to measure next."""
    tests = [[Cell(one.what), Cell(one.result)] for one in doubts]
    rows = [
        [Cell(one.name), *map(number, shown(one)), Cell(one.unit),
         Cell(str(one.verdict), _MARKS[one.verdict]), Cell(one.note)]
        for one in found.figures
    ]  # fmt: skip
    headings = ["", "value", "95 %", "unit", "verdict", ""]
    (simulated,) = respond(found.fit.grid, [found.fit.values], found.fit.problem.known)
    ways = (
        "Delays are from the wheel's angle to the yaw rate, those of further sensors after it, and"
        " those of the actuator from the command to the wheel's angle."
    )
    frequency = "Yaw rate over steering; grey where less than 80 % of it follows the steering."
    plan = (
        "A sweep at 60 km/h from 0.2 to 3 Hz in 26 s with 4 m/s² to either side, steps at 80 km/h,"
        " and a slalom that grows up to the limit of grip: on an empty ground."
    )
    asks_for_slow = any("25 km/h" in one.note for one in found.figures)
    if asks_for_slow:
        plan += " Then the sweep at 25 km/h, with 2 m/s²: it tells relaxation from delay."
    sections = [
        Section("Figures", [ways], tables=[Table(headings, rows)]),
        Section("Delays", lines),
        Section(
            "Measured over simulated",
            [f"Residual of yaw rate: {found.fit.residual_percent:.2f} %"],
            [_response_picture(found, simulated)], [Table(["test", "result"], tests)], found.notes,
        ),
        Section("Frequency response", [frequency], [_frequency_picture(found, simulated[0])]),
        Section("What to drive next", [plan], [_plan_picture(asks_for_slow)]),
    ]  # fmt: skip
    return page(f"Car identified from {source}", sections)


def _response_picture(found: Identification, simulated: Sequence[FloatArray]) -> Picture:
    judged = found.fit.grid.judged
    with plot_style():
        canvas = Canvas(figsize=(9.0, 2.6 * len(judged)))
        panels = canvas.subplots(len(judged), 1, sharex=True, squeeze=False)[:, 0]
        for axes, sensor, values in zip(panels, judged, simulated, strict=True):
            axes.plot(sensor.time_s, sensor.values, label="measured")
            axes.plot(sensor.time_s, values, label="simulated")
            name = _UNIT_OF_NAME.sub("", sensor.name).replace("_", " ")
            axes.set_ylabel(f"{name} [{_UNITS[sensor.quantity]}]", fontsize=8)
        panels[0].legend(ncols=2)
        panels[-1].set_xlabel("time [s]")
    return Picture(png_of(canvas), "measured and simulated over time")


def _frequency_picture(found: Identification, rates_rad_s: FloatArray) -> Picture:
    grid, every = found.fit.grid, round(_PERIOD_S / STEP_S)
    rate = grid.judged[0]
    longest = int(np.argmax(np.diff(grid.starts)))
    part = slice(grid.starts[longest], grid.starts[longest + 1], every)
    steering, at_s = grid.steering_rad[part], grid.time_s[part]
    measured, simulated = (np.interp(at_s, rate.time_s, one) for one in (rate.values, rates_rad_s))
    options = {"fs": 1.0 / _PERIOD_S, "nperseg": min(round(_WINDOW_S / _PERIOD_S), len(steering))}
    hz, own = csd(steering, steering, **options)
    inside = (hz > 0.1) & (hz < _HZ_MAX)
    with plot_style():
        canvas = Canvas(figsize=(9.0, 6.0))
        gain, phase, coherence_of = canvas.subplots(3, 1, sharex=True)
        both = ("measured", measured, "C0.-"), ("simulated", simulated, "C1.-")
        for label, output, style in both:
            shared = coherence(steering, output, **options)[1]
            sure, ratio = inside & (shared > _COHERENT), csd(steering, output, **options)[1] / own
            gain.plot(hz[inside], np.abs(ratio[inside]), color="0.8", linewidth=1.0)
            gain.plot(hz[sure], np.abs(ratio[sure]), style, label=label)
            phase.plot(hz[sure], np.degrees(np.angle(ratio[sure])), style)
            coherence_of.plot(hz[inside], shared[inside], style)
        gain.legend(ncols=2)
        gain.set_ylabel("gain [1/s]")
        phase.set_ylabel("phase [deg]")
        coherence_of.set(ylabel="coherence", xlabel="frequency [Hz]", ylim=(0.0, 1.05))
    return Picture(png_of(canvas), "frequency response from steering to yaw rate, with coherence")


def _plan_picture(asks_for_slow: bool) -> Picture:
    time_s = np.arange(0.0, 100.0 if asks_for_slow else 70.0, 0.01)
    side = np.zeros(len(time_s))
    for start_s, level in ((4.0, 4.0), (72.0, 2.0)):
        sweep_s = np.clip(time_s - start_s, 0.0, 26.0)
        cycles = 0.2 * 26.0 / np.log(15.0) * (15.0 ** (sweep_s / 26.0) - 1.0)
        side += level * np.sin(2.0 * np.pi * cycles) * (sweep_s < 26.0)
    for start_s, end_s, level in ((41.0, 44.0, 3.0), (46.0, 49.0, -3.5), (51.0, 53.0, 2.0)):
        side[(time_s > start_s) & (time_s < end_s)] = level
    slalom_s = np.clip(time_s - 55.0, 0.0, 14.0)
    side += 8.0 * slalom_s / 14.0 * np.sin(2.0 * np.pi * 0.45 * slalom_s) * (slalom_s < 14.0)
    with plot_style():
        canvas = Canvas(figsize=(9.0, 2.6))
        axes = canvas.subplots()
        axes.plot(time_s, side)
        title = "60 km/h, from 40 s on 80 km/h" + ", from 70 s on 25 km/h" * asks_for_slow
        axes.set(xlabel="time [s]", ylabel="lateral acceleration [m/s²]", title=title)
    return Picture(png_of(canvas), "lateral acceleration to drive, over time")
