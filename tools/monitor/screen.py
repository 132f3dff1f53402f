"""From a view to lines of text: 22 of them, as wide as the terminal, 80 columns at least."""

import math

from rich.text import Text

from ...closed_loop.recordings.live_view import MessageView, View
from ...closed_loop.recordings.status_lights import (
    BAD,
    GOOD,
    NOTICE,
    OFF,
    lights_of,
    measurements_that_are,
)
from ...dbc import messages
from ...dbc.messages import EchoState, Freshness, SecondSender

WIDTH_MIN = 80
_ONE_MS = 1e3
_STYLES = {GOOD: "bold green", NOTICE: "bold yellow", BAD: "bold red", OFF: "bold"}


def screen_lines(view: View, bus: str, width: int = WIDTH_MIN) -> list[Text]:
    """Return the lines of the screen, none wider than ``width``."""
    lines = [_title(view, bus, width), _state(view), *_signals(view), *_latency(view)]
    lines += [Text(_HEAD, style="bold"), *_messages(view), _refused(view)]
    for line in lines:
        line.truncate(width)
    return lines


def one_line(view: View) -> str:
    """Return the most important of a view on one line, for a file or a pipe."""
    newest, trip = view.newest, view.round_trip
    plant = newest.of(messages.PlantStatus)
    off, command = newest.of(messages.LateralError), newest.of(messages.SteeringCommand)
    status = newest.of(messages.ControllerStatus)
    one_way_s = () if plant is None else (plant.downlink_latency_s, plant.uplink_latency_s)
    round_trip_s = () if trip is None else (trip.p50_s, trip.p99_s)
    error = "-" if off is None else f"{_ONE_MS * off.lateral_error_m:+.2f}"
    cg = "-" if math.isnan(view.cg_deviation_m) else f"{_ONE_MS * view.cg_deviation_m:+.2f}"
    steer = "-" if command is None else f"{_ONE_MS * command.steer_rad:+.2f}"
    missing = sum(row.missing - row.late for row in view.messages)
    mode = "-" if status is None else status.mode.name
    return (
        f"{view.elapsed_s:.1f} s  {mode}  error {error} mm  CG {cg} mm  steer {steer} mrad  "
        f"down/up {_pair_ms(one_way_s)} ms  round trip {_pair_ms(round_trip_s)} ms  "
        f"{view.frames_per_s:.0f} frames/s  missing {missing}  "
        f"refused {sum(view.refused.values())}  foreign {view.foreign_frames}"
        f"{_second_senders(view)}"
    )


def _title(view: View, bus: str, width: int) -> Text:
    seconds = int(view.elapsed_s)
    clock = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    name = "monitor  "
    room = max(width - len(name) - len(clock) - 2, 0)
    text = Text(name, style="bold")
    text.append(bus[:room].ljust(room), style="not bold")
    return text.append(f"  {clock}", style="not bold")


def _state(view: View) -> Text:
    law, skipped = "", "-"
    if (status := view.newest.of(messages.ControllerStatus)) is not None:
        law, skipped = f" {status.law.name}", str(status.skipped_ticks)
    controller, _, _, actuator, *_ = lights_of(view.newest, {}, names=view.names)
    text = Text("controller ").append(controller.state, style=_STYLES[controller.level])
    text.append(f"{law}, {skipped} ticks skipped").append(_alarms(view), style="bold red")
    text.append("   actuator ").append(actuator.state, style=_STYLES[actuator.level])
    return text.append(f"   {view.frames_per_s:.0f} frames/s")


def _signals(view: View) -> list[Text]:
    of = view.newest.of
    error, command = of(messages.LateralError), of(messages.SteeringCommand)
    steering, vehicle = of(messages.SteeringStatus), of(messages.VehicleState)
    status = of(messages.ControllerStatus)
    cg_m = None if math.isnan(view.cg_deviation_m) else view.cg_deviation_m
    return [
        _pair(
            _value("lateral error", error and error.lateral_error_m, _ONE_MS, 2, "mm"),
            _value("CG off path", cg_m, _ONE_MS, 2, "mm"),
            view.is_stale("LATERAL_ERROR"),
        ),
        _pair(
            _value("steer", command and command.steer_rad, _ONE_MS, 2, "mrad"),
            _value("wheel", steering and steering.wheel_angle_rad, _ONE_MS, 2, "mrad"),
            view.is_stale("STEERING_COMMAND"),
        ),
        _pair(
            _value("speed", vehicle and vehicle.speed_m_s, 1.0, 3, "m/s"),
            _value("yaw rate", vehicle and vehicle.yaw_rate_rad_s, _ONE_MS, 1, "mrad/s"),
            view.is_stale("VEHICLE_STATE"),
        ),
        _pair(
            _value("curvature", vehicle and vehicle.preview_curvature_1_m, 1.0, 5, "1/m"),
            _value("heading err", error and error.heading_error_rad, _ONE_MS, 1, "mrad"),
            view.is_stale("VEHICLE_STATE"),
        ),
        _pair(
            _value("disturbance", status and status.disturbance_rad, _ONE_MS, 0, "mrad"),
            _value("network", status and status.network_disturbance_rad, _ONE_MS, 0, "mrad"),
            view.is_stale("CONTROLLER_STATUS"),
        ),
        _pair(_delay(view), _model(view), view.is_stale("CONTROLLER_STATUS")),
    ]


def _latency(view: View) -> list[Text]:
    plant, trip = view.newest.of(messages.PlantStatus), view.round_trip
    is_stale = view.is_stale("PLANT_STATUS")
    trip_s = None if math.isnan(view.round_trip_s) else view.round_trip_s
    spread = (
        ""
        if trip is None
        else " ".join(
            f"{name} {_ms(value_s)}"
            for name, value_s in zip(("p50", "p99", "max"), trip, strict=True)
        )
    )
    word = "latency, the plant's word"
    rows = (
        ("commands", plant and plant.downlink_latency_s, word, is_stale),
        ("measurements", plant and plant.uplink_latency_s, word, is_stale),
        ("round trip", trip_s, spread, False),
    )
    return [
        _pair(_value(label, value, _ONE_MS, 2, "ms", sign=""), remark, is_old)
        for label, value, remark, is_old in rows
    ]


def _delay(view: View) -> str:
    """Return the delay down and up, by echo; - where it is not known now."""
    delay = view.newest.of(messages.DelayStatus)
    if delay is None:
        return ""
    echo = f"{_ONE_MS * delay.echo_delay_s:.0f}" if delay.echo_state is EchoState.KNOWN else "-"
    return f"delay: echo {echo} ms"


def _model(view: View) -> str:
    """Return the steering lag and the virtual mass that the law steers by."""
    model = view.newest.of(messages.ModelStatus)
    if model is None:
        return ""
    return f"{_ONE_MS * model.steering_lag_s:.0f} ms, {model.virtual_mass_kg:.0f} kg"


def _pair(left: str, right: str, is_stale: bool) -> Text:
    return Text(f"{left:30} {right}", style="dim" if is_stale else "")


def _value(
    label: str, value: float | None, scale: float, digits: int, unit: str, sign: str = "+"
) -> str:
    number = "-" if value is None else f"{scale * value:{sign}.{digits}f}"
    return f"{label}{number:>{22 - len(label)}} {unit}"


_HEAD = (
    f"{'message':17}{'due':>5}{'median':>8}{'p99':>8}{'max':>8}{'frames':>10}"
    f"{'missing':>8}{'late':>6}{'refused':>8}"
)


def _messages(view: View) -> list[Text]:
    by_tools = [row for row in view.messages if row.period_s is None]
    counts = ", ".join(f"{row.name} {row.accepted} ({row.refused} refused)" for row in by_tools)
    cyclic = [_message(row, row.period_s) for row in view.messages if row.period_s is not None]
    return [*cyclic, Text(counts, style="dim")]


def _message(row: MessageView, period_s: float) -> Text:
    period = f"{_ONE_MS * period_s:.0f}"
    cycle = "" if row.cycle is None else "".join(f"{_ms(value):>8}" for value in row.cycle)
    middle = "  stays away" if row.is_stale else cycle
    text = Text(
        f"{row.name:17}{period:>5}{middle:24}{row.accepted:>10}{row.missing:>8}{row.late:>6}",
        style="dim" if row.is_stale or not row.accepted else "",
    )
    return text.append(f"{row.refused:>8}", style="red" if row.refused else "")


def _refused(view: View) -> Text:
    ids = ",".join(f"{can_id:X}" for can_id in view.foreign_ids[:4])
    more = ",.." if len(view.foreign_ids) > 4 else ""
    plant, safety = _nodes(view)
    nodes = (("plant", plant), ("controller", safety))
    counts = ", ".join(f"{who} {one.lost}/{one.rejected}" for who, one in nodes if one is not None)
    counted = f"; lost/refused: {counts}" if counts else ""
    causes = ", ".join(f"{cause} {count}" for cause, count in view.refused.items()) or "0"
    return Text(
        f"refused: {causes}; foreign {view.foreign_frames}"
        f"{f' ({ids}{more})' if ids else ''}; error frames {view.error_frames}{counted}"
    )


def _nodes(view: View) -> tuple[messages.PlantStatus | None, messages.ControllerSafety | None]:
    return view.newest.of(messages.PlantStatus), view.newest.of(messages.ControllerSafety)


def _alarms(view: View) -> str:
    (_, safety), stale = _nodes(view), list[str]()
    if safety is not None:
        stale = measurements_that_are(Freshness.STALE, safety, view.names)
    return "".join(f", {name} stale" for name in stale) + _second_senders(view)


def _second_senders(view: View) -> str:
    own, peer = SecondSender.OWN, SecondSender.PEER
    plant, safety = _nodes(view)
    seen = [SecondSender.NONE if node is None else node.second_sender for node in (safety, plant)]
    notices = {"controller": (own, peer), "plant": (peer, own)}
    return "".join(
        f", TWO SENDERS as {name}"
        for name, bits in notices.items()
        if any(one & bit for one, bit in zip(seen, bits, strict=True))
    )


def _pair_ms(values_s: tuple[float, ...]) -> str:
    return "/".join(map(_ms, values_s)) or "-/-"


def _ms(value_s: float) -> str:
    value_ms = _ONE_MS * value_s
    return f"{value_ms:.{2 if value_ms < 10 else 1 if value_ms < 1000 else 0}f}"
