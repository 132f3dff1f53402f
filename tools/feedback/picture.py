"""Pictures of ``steer-by-wire feedback``: first unstable round trips, and the frontier of laws."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import isfinite

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from steer_by_wire.closed_loop.reports.plot_style import plot_style, png_of
from steer_by_wire.dbc.messages import (
    ACTIVE_CYCLE_TIMES_MS,
    CAN_IDS,
    CYCLE_TIMES_MS,
    HandWheelFeedback,
    HandWheelState,
    HandWheelStatus,
    Message,
    SteeringForce,
)
from steer_by_wire.hand_wheel.wheel import GRIPS
from steer_by_wire.runtime.bus_model.response_times import sending_of, wire_of, worst_response_ns
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.tools.feedback.frontier import Point

FIRST_MS_MIN = 0.3
"""Of the logarithmic axis; what is unstable without a delay lies below it."""
FELT_LATE_MS = {
    45.0: "sight against touch",
    75.0: "tasks suffer",
    200.0: "steering suffers severely",
}
"""As the literature has it (Smith and Kaplan 1970 for the last); none is of a steer-by-wire."""
REAL_BUS_MS = 20.0
"""A cycle of 10 ms each way."""
BITRATE_BIT_S = 500_000
_THERE_AND_BACK: tuple[type[Message], ...] = (HandWheelState, SteeringForce)
Curve = tuple[float, str, float, float]
"""Speed [km/h], grip, torque gradient [N m/rad] and first unstable round trip [s] of a point."""


def both_ways_ms(cycle_s: float) -> tuple[float, float | None]:
    """Return what HAND_WHEEL_STATE and STEERING_FORCE take together on a bus of their own nodes.

    First their frames, then how long both wait for the others at most, None without a bound.
    """
    periods_ms: dict[type[Message], float] = {k: ms for k, ms in CYCLE_TIMES_MS.items() if ms}
    periods_ms |= {k: ACTIVE_CYCLE_TIMES_MS[k] for k in (HandWheelFeedback, HandWheelStatus)}
    periods_ms |= dict.fromkeys(_THERE_AND_BACK, 1e3 * cycle_s)
    wire, sendings = wire_of(BITRATE_BIT_S), {}
    for kind, period_ms in periods_ms.items():
        frame, period_ns = Frame(CAN_IDS[kind], bytes(8)), round(period_ms * NS_PER_MS)
        sendings[kind] = sending_of(kind.__name__, frame, period_ns, BITRATE_BIT_S, BITRATE_BIT_S)
    both = [sendings[kind] for kind in _THERE_AND_BACK]
    frames_ns = sum(message.frame_ns for message in both)
    bounds_ns = [worst_response_ns(message, [*sendings.values()], wire) for message in both]
    known_ns = [bound_ns for bound_ns in bounds_ns if bound_ns is not None]
    waiting_ms = (sum(known_ns) - frames_ns) / NS_PER_MS if len(known_ns) == len(both) else None
    return frames_ns / NS_PER_MS, waiting_ms


def draw(models: Sequence[Sequence[Curve]], cycle_s: float, title: str) -> bytes:
    """Return a PNG with a panel for each speed and a curve for each grip.

    ``models``  with tyres that follow at once and, dashed, with tyres that lag
    """
    speeds_km_h = sorted({speed for speed, *_ in models[0]})
    with plot_style():
        figure = Figure(figsize=(4.0 * len(speeds_km_h) + 1.0, 4.4))
        panels = figure.subplots(1, len(speeds_km_h), sharey=True, squeeze=False)[0]
        for axes, speed_km_h in zip(panels, speeds_km_h, strict=True):
            for rows, dash in zip(models, ("-", "--"), strict=False):
                for number, grip in enumerate(GRIPS):
                    curve = [row[2:] for row in rows if row[:2] == (speed_km_h, grip)]
                    gradients, firsts_s = zip(*curve, strict=True)
                    firsts_ms = [max(1e3 * first_s, 0.1) for first_s in firsts_s]
                    axes.plot(gradients, firsts_ms, f"C{number}{dash}")
            axes.set(
                title=f"{title}, {speed_km_h:g} km/h", xscale="log", yscale="log",
                xlabel="torque gradient [N m/rad]", ylim=(FIRST_MS_MIN, None),
            )  # fmt: skip
            axes.xaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_major_formatter("{x:g}")
        shaking = {grip for _, grip, _, first_s in models[0] if isfinite(first_s)}
        for number, grip in enumerate(GRIPS):
            label = grip.replace("_", " ") + ("" if grip in shaking else ": never")
            panels[-1].plot([], [], f"C{number}-", label=label)
        if len(models) > 1:
            panels[-1].plot([], [], "k--", label="tyres that lag")
        _mark_bus(panels, cycle_s)
        panels[0].set_ylabel("first unstable round trip [ms]")
        figure.legend(loc="outside lower center", ncols=min(3 * len(panels), 5), fontsize=8)
    return png_of(figure)


def _mark_bus(panels: Iterable[Axes], cycle_s: float) -> None:
    """Mark what the bus takes of a round trip: frames, cycles, and the jitter by waiting."""
    cycles_ms, (frames_ms, waiting_ms) = 2e3 * cycle_s, both_ways_ms(cycle_s)
    frames = f"two frames at\n{BITRATE_BIT_S / 1000:g} kbit/s: {frames_ms:.2f} ms"
    cycles = f"a cycle each way:\n{cycles_ms:g} ms"
    marks = [(frames_ms, frames, "top"), (cycles_ms, cycles, "top")]
    if waiting_ms is None:
        marks[1] = cycles_ms, f"{cycles}, too short\nfor this bus", "bottom"
    else:
        words = f"jitter: both frames\nwait for others,\nup to {waiting_ms:.1f} ms more"
        marks.append((cycles_ms + waiting_ms, words, "bottom"))
    for axes in panels:
        axes.axhspan(cycles_ms, marks[-1][0], color="0.5", alpha=0.2)
        for at_ms, _, _ in marks:
            axes.axhline(at_ms, color="0.5", linewidth=1.0)
    for at_ms, words, va in marks:
        margin = axes.get_yaxis_transform()
        axes.text(1.02, at_ms, words, va=va, transform=margin, color="0.3", fontsize=8)


def draw_frontier(models: Sequence[Iterable[Point]], title: str) -> bytes:
    """Return a PNG: how changed and how late the road is felt, over the round trip of the bus.

    ``models``  with tyres that follow at once and, below, with tyres that lag
    """
    with plot_style():
        figure = Figure(figsize=(10.0, 4.2 * len(models)))
        for row, points in enumerate(models):
            panels = [figure.add_subplot(len(models), 2, 2 * row + side) for side in (1, 2)]
            below = ", tyres that lag" if row else ""
            _draw_laws(panels[0], panels[1], points, f"{title}{below}")
    return png_of(figure)


def _draw_laws(changed: Axes, late: Axes, points: Iterable[Point], title: str) -> None:
    for law, each in groupby(points, lambda point: point.law):
        of_law = list(each)
        trips = [1e3 * point.round_trip_s for point in of_law]
        label = law if any(isfinite(point.changed) for point in of_law) else None
        changed.plot(trips, [1e2 * point.changed for point in of_law], marker=".", label=label)
        late.plot(trips, [1e3 * point.late_s for point in of_law], marker=".")
    for at_ms, words in FELT_LATE_MS.items():
        late.axhline(at_ms, color="0.6", linewidth=0.8)
        late.annotate(words, (trips[0], 1.04 * at_ms), color="0.4", fontsize=8)
    for axes, what in ((changed, "felt torque changed by [%]"), (late, "road felt after [ms]")):
        axes.axvspan(trips[0], REAL_BUS_MS, color="0.5", alpha=0.12)
        axes.set(xscale="log", yscale="log", xlabel="round trip of the bus [ms]", ylabel=what)
        axes.set_xticks(trips, [f"{trip:g}" for trip in trips], minor=False)
        axes.set_xticks([], minor=True)
        axes.yaxis.set_major_formatter("{x:g}")
    changed.set(title=title, ylim=(2.0, 2000.0))
    changed.annotate("a cycle of 10 ms each way", (trips[0], 2.2), color="0.4", fontsize=8)
    changed.legend(fontsize=8)
