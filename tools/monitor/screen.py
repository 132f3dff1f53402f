"""A watched bus as lines of text: 22 of them, as wide as the terminal, 80 columns at least."""

import math
from collections.abc import Iterator, Sequence

from rich.text import Text

from ...closed_loop.recordings.live_view import BusWatch, MessageView
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
from ...runtime.node import NS_PER_S

WIDTH_MIN = 80
_ONE_MS = 1e3
_SIGNALS = (
    ("lateral error", messages.LateralError, "lateral_error_m", _ONE_MS, 2, "mm"),
    ("CG off path", None, "", _ONE_MS, 2, "mm"),
    ("steer", messages.SteeringCommand, "steer_rad", _ONE_MS, 2, "mrad"),
    ("wheel", messages.SteeringStatus, "wheel_angle_rad", _ONE_MS, 2, "mrad"),
    ("speed", messages.VehicleState, "speed_m_s", 1.0, 3, "m/s"),
    ("yaw rate", messages.VehicleState, "yaw_rate_rad_s", _ONE_MS, 1, "mrad/s"),
    ("curvature", messages.VehicleState, "preview_curvature_1_m", 1.0, 5, "1/m"),
    ("heading err", messages.LateralError, "heading_error_rad", _ONE_MS, 1, "mrad"),
    ("disturbance", messages.ControllerStatus, "disturbance_rad", _ONE_MS, 0, "mrad"),
    ("network", messages.ControllerStatus, "network_disturbance_rad", _ONE_MS, 0, "mrad"),
)
"""Two on a line: label, message (None: computed), field, how many of the unit are one, digits."""
_FRESH_WITH = (
    "LATERAL_ERROR", "STEERING_COMMAND", "VEHICLE_STATE", "VEHICLE_STATE", "CONTROLLER_STATUS",
)  # fmt: skip
"""The message without which each of these lines is dim."""
_STYLES = {GOOD: "bold green", NOTICE: "bold yellow", BAD: "bold red", OFF: "bold"}


def screen_lines(watch: BusWatch, now_ns: int, bus: str, width: int = WIDTH_MIN) -> list[Text]:
    """Return the lines of the screen, none wider than ``width``."""
    rows = watch.messages(now_ns)
    stale = {row.name for row in rows if row.is_stale}
    names = watch.listener.listening.names
    lines = [_title(watch, now_ns, bus, width), _state(watch, now_ns)]
    for name, left, right in (*_signals(watch), *_latency(watch, now_ns)):
        style = "dim" if names.get(name, name) in stale else ""
        lines.append(Text(f"{left:30} {right}", style=style))
    lines += [Text(_HEAD, style="bold"), *_messages(rows), _refused(watch)]
    for line in lines:
        line.truncate(width)
    return lines


def one_line(watch: BusWatch, now_ns: int) -> str:
    """Return the most important figures on one line, for a file or a pipe."""
    of, trip = watch.newest().of, watch.round_trips.spread(now_ns)
    plant, status = of(messages.PlantStatus), of(messages.ControllerStatus)
    off, command = of(messages.LateralError), of(messages.SteeringCommand)
    one_way_s = () if plant is None else (plant.downlink_latency_s, plant.uplink_latency_s)
    round_trip_s = () if trip is None else (trip.p50_s, trip.p99_s)
    error = "-" if off is None else f"{_ONE_MS * off.lateral_error_m:+.2f}"
    cg = "-" if math.isnan(watch.cg_deviation_m) else f"{_ONE_MS * watch.cg_deviation_m:+.2f}"
    steer = "-" if command is None else f"{_ONE_MS * command.steer_rad:+.2f}"
    missing = sum(row.missing - row.late for row in watch.messages(now_ns))
    mode = "-" if status is None else status.mode.name
    elapsed_s = (now_ns - watch.start_ns) / NS_PER_S
    return (
        f"{elapsed_s:.1f} s  {mode}  error {error} mm  CG {cg} mm  steer {steer} mrad  "
        f"down/up {_pair_ms(one_way_s)} ms  round trip {_pair_ms(round_trip_s)} ms  "
        f"{watch.frames_per_s(now_ns):.0f} frames/s  missing {missing}  "
        f"refused {sum(watch.listener.refused.values())}  foreign {watch.listener.foreign_frames}"
        f"{_second_senders(watch)}"
    )


def _title(watch: BusWatch, now_ns: int, bus: str, width: int) -> Text:
    seconds = (now_ns - watch.start_ns) // NS_PER_S
    clock = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    name = "monitor  "
    room = max(width - len(name) - len(clock) - 2, 0)
    return Text.assemble((name, "bold"), f"{bus[:room]:{room}}  {clock}")


def _state(watch: BusWatch, now_ns: int) -> Text:
    law, skipped, newest = "", "-", watch.newest()
    if (status := newest.of(messages.ControllerStatus)) is not None:
        law, skipped = f" {status.law.name}", str(status.skipped_ticks)
    names = watch.listener.listening.names
    controller, _, _, actuator, *_ = lights_of(newest, {}, names=names)
    stale = list[str]()
    if (safety := newest.of(messages.ControllerSafety)) is not None:
        stale = measurements_that_are(Freshness.STALE, safety, names)
    alarms = "".join(f", {name} stale" for name in stale) + _second_senders(watch)
    return Text.assemble(
        "controller ",
        (controller.state, _STYLES[controller.level]),
        f"{law}, {skipped} ticks skipped",
        (alarms, "bold red"),
        "   actuator ",
        (actuator.state, _STYLES[actuator.level]),
        f"   {watch.frames_per_s(now_ns):.0f} frames/s",
    )


def _signals(watch: BusWatch) -> Iterator[tuple[str, str, str]]:
    """Yield the message without which a line is dim, and its two parts."""
    newest, shown = watch.newest(), list[str]()
    for label, kind, field, scale, digits, unit in _SIGNALS:
        message = kind and newest.of(kind)
        value = watch.cg_deviation_m if kind is None else message and getattr(message, field)
        shown.append(_value(label, value, scale, digits, unit))
    yield from zip(_FRESH_WITH, shown[::2], shown[1::2], strict=True)
    delay, model = newest.of(messages.DelayStatus), newest.of(messages.ModelStatus)
    delay_text = model_text = ""
    if delay is not None:
        is_known = delay.echo_state is EchoState.KNOWN
        delay_text = f"delay: echo {f'{_ONE_MS * delay.echo_delay_s:.0f}' if is_known else '-'} ms"
    if model is not None:
        lag_ms = _ONE_MS * model.steering_lag_s
        model_text = f"{lag_ms:.0f} ms, {model.virtual_mass_kg:.0f} kg"
    yield "CONTROLLER_STATUS", delay_text, model_text


def _latency(watch: BusWatch, now_ns: int) -> Iterator[tuple[str, str, str]]:
    plant, trip = watch.newest().of(messages.PlantStatus), watch.round_trips.spread(now_ns)
    names = zip(("p50", "p99", "max"), trip or (), strict=False)
    spread = " ".join(f"{name} {_ms(value_s)}" for name, value_s in names)
    word = "latency, the plant's word"
    for message, label, value_s, remark in (
        ("PLANT_STATUS", "commands", plant and plant.downlink_latency_s, word),
        ("PLANT_STATUS", "measurements", plant and plant.uplink_latency_s, word),
        ("", "round trip", watch.round_trips.newest(now_ns), spread),
    ):
        yield message, _value(label, value_s, _ONE_MS, 2, "ms", sign=""), remark


def _value(
    label: str, value: float | None, scale: float, digits: int, unit: str, sign: str = "+"
) -> str:
    number = "-" if value is None or math.isnan(value) else f"{scale * value:{sign}.{digits}f}"
    return f"{label}{number:>{22 - len(label)}} {unit}"


_HEAD = (
    f"{'message':17}{'due':>5}{'median':>8}{'p99':>8}{'max':>8}{'frames':>10}"
    f"{'missing':>8}{'late':>6}{'refused':>8}"
)


def _messages(rows: Sequence[MessageView]) -> list[Text]:
    by_tools = [row for row in rows if row.period_s is None]
    counts = ", ".join(f"{row.name} {row.accepted} ({row.refused} refused)" for row in by_tools)
    cyclic = [_message(row, row.period_s) for row in rows if row.period_s is not None]
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


def _refused(watch: BusWatch) -> Text:
    listener, of = watch.listener, watch.newest().of
    ids = ",".join(f"{can_id:X}" for can_id in [*listener.foreign][:4])
    more = ",.." if len(listener.foreign) > 4 else ""
    nodes = ("plant", of(messages.PlantStatus)), ("controller", of(messages.ControllerSafety))
    counts = ", ".join(f"{who} {one.lost}/{one.rejected}" for who, one in nodes if one is not None)
    counted = f"; lost/refused: {counts}" if counts else ""
    causes = ", ".join(f"{cause} {count}" for cause, count in listener.refused.items()) or "0"
    return Text(
        f"refused: {causes}; foreign {listener.foreign_frames}"
        f"{f' ({ids}{more})' if ids else ''}; error frames {listener.error_frames}{counted}"
    )


def _second_senders(watch: BusWatch) -> str:
    """Return the nodes whose messages someone else sends too, as either node reports it."""
    of, none = watch.newest().of, SecondSender.NONE
    safety, plant = of(messages.ControllerSafety), of(messages.PlantStatus)
    by_controller = none if safety is None else safety.second_sender
    by_plant = none if plant is None else plant.second_sender
    own, peer = SecondSender.OWN, SecondSender.PEER
    is_seen = {
        "controller": by_controller & own or by_plant & peer,
        "plant": by_controller & peer or by_plant & own,
    }
    return "".join(f", TWO SENDERS as {name}" for name, seen in is_seen.items() if seen)


def _pair_ms(values_s: tuple[float, ...]) -> str:
    return "/".join(map(_ms, values_s)) or "-/-"


def _ms(value_s: float) -> str:
    value_ms = _ONE_MS * value_s
    return f"{value_ms:.{2 if value_ms < 10 else 1 if value_ms < 1000 else 0}f}"
