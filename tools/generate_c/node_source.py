"""The files of the node around a law: its settings and the messages' layouts, and what is by hand.

``node/`` has the C that is written by hand, and ``closed_loop/lockstep`` the protocol with its two
machines. All are copied, so that the folder needs nothing else.
"""

from collections.abc import Iterator
from importlib.resources import files

from steer_by_wire.controller.limits.designed_ranges import designed_ranges_of
from steer_by_wire.controller.node.model_fit import gradients_s2_m
from steer_by_wire.controller.node.newest_messages import RECEIVED, SENT
from steer_by_wire.controller.node.plausibility import nominal_vehicle
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.codec.layout import MessageLayout, SignalLayout
from steer_by_wire.dbc.contract.generated_layout import LAYOUTS
from steer_by_wire.dbc.contract.message_records import MESSAGE_TYPES
from steer_by_wire.runtime.frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, FD
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.settings import SettingsError

from .records import hexadecimal

_PROTOCOL = "steer_by_wire.closed_loop.lockstep"
_HEADER = """\
/* {title}
 *
 * What the node around the law was given, and where its messages have their signals.
 */
#ifndef NODE_SETTINGS_H
#define NODE_SETTINGS_H

#include "messages.h"

{defines}

{messages}

#endif
"""
_SOURCE = """\
/* The messages that the node sends and receives, as steer_by_wire.dbc defines them. */
#include "node_settings.h"

{tables}"""
_NO_LIMIT = 1_000_000
"""More overruns or missed periods than any window has."""


def node_source(settings: ControllerSettings, title: str) -> dict[str, str]:
    """Return the texts of all files but the law's, by their names.

    Raises SettingsError for settings that the node in C does not know.
    """
    if settings.supervision.second_sender == "silent":
        raise SettingsError('supervision.second_sender = "silent" does not become C: leave it out')
    if settings.supervision.stops_if_implausible:
        raise SettingsError("supervision.stops_if_implausible does not become C: leave it out")
    layouts = [layout for layout in LAYOUTS if MESSAGE_TYPES[layout.name] in {*RECEIVED, *SENT}]
    largest = {
        "SIGNALS_MAX": max(len(layout.signals) for layout in layouts),
        "PAYLOAD_MAX": max(layout.length for layout in layouts),
    }
    values = [*largest.items(), *_defines(settings)]
    defines = "\n".join(f"#define {name} {value}" for name, value in values)
    header = _HEADER.format(
        title=title, defines=defines, messages="\n".join(map(_indices, layouts))
    )
    source = _SOURCE.format(tables="\n".join(map(_table, layouts)))
    by_hand = {
        file.name: file.read_text(encoding="utf-8")
        for folder in (files(__package__) / "node", files(_PROTOCOL))
        for file in folder.iterdir()
        if file.is_file() and not file.name.endswith(".py")
    }
    return {"node_settings.h": header, "node_settings.c": source, **by_hand}


def _defines(settings: ControllerSettings) -> Iterator[tuple[str, str]]:
    table, ages, counters = settings.supervision, settings.age_limits, settings.counters
    yield "LAW_NUMBER", str(int(settings.law_record.number))
    yield "LATERAL_ERROR_AGE_NS", _long(ages.lateral_error_ns)
    yield "STEERING_STATUS_AGE_NS", _long(ages.steering_status_ns)
    yield "VEHICLE_STATE_AGE_NS", _long(ages.vehicle_state_ns)
    yield "HOLD_NS", _long(round(table.hold_ms * NS_PER_MS))
    yield "RECOVERY_FRAMES", str(table.recovery_frames)
    yield "LEAD_NS", _long(counters.lead_ns)
    yield "RESYNC_RUN", str(counters.resync_run)
    yield "RESYNC_NS", _long(counters.resync_ns)
    yield "DELAY_AVERAGING_NS", _long(round(settings.link.delay_averaging_s * NS_PER_S))
    overruns = settings.overruns
    yield "OVERRUNS_MAX", _bound(overruns.overruns_max)
    yield "OVERRUN_WINDOW_TICKS", str(overruns.window_ticks)
    yield "MISSED_PERIODS_MAX", _bound(overruns.missed_periods_max)
    yield "MISSED_WINDOW_PERIODS", str(overruns.window_periods)
    yield "STALL_PERIODS_MAX", str(overruns.stall_periods_max)
    validity, vehicle = settings.validity, nominal_vehicle(settings)
    yield "HAS_VALIDITY", str(int(validity is not None))
    ranges = designed_ranges_of(validity)
    yield "SPEED_M_S_MAX", hexadecimal(ranges.speed_m_s_max)
    yield "SPEED_TOLERATED_M_S_MIN", hexadecimal(ranges.tolerated_m_s_min)
    yield "SPEED_TOLERATED_M_S_MAX", hexadecimal(ranges.tolerated_m_s_max)
    yield "DELAY_S_MAX", hexadecimal(1e-3 * validity.delay_ms_max if validity else 0.0)
    has_fit = vehicle is not None and validity is not None
    yield "HAS_MODEL_FIT", str(int(has_fit))
    least, largest = gradients_s2_m(vehicle, validity) if vehicle and validity else (0.0, 0.0)
    yield "GRADIENT_LEAST_S2_M", hexadecimal(least)
    yield "GRADIENT_LARGEST_S2_M", hexadecimal(largest)
    fields = vehicle._asdict() if vehicle else {}
    for name in (
        "virtual_mass_kg", "yaw_inertia_kg_m2", "front_cornering_stiffness_n_rad",
        "rear_cornering_stiffness_n_rad", "front_axle_distance_m", "rear_axle_distance_m",
    ):  # fmt: skip
        yield name.upper(), hexadecimal(fields.get(name, 1.0))
    yield "LENGTH_M", "(FRONT_AXLE_DISTANCE_M + REAR_AXLE_DISTANCE_M)"


def _long(value: int) -> str:
    return f"INT64_C({value})"


def _bound(value: int | str) -> str:
    return str(_NO_LIMIT if isinstance(value, str) else value)


def _indices(layout: MessageLayout) -> str:
    """Return where a message's signals stand among its raws."""
    names = [f"{layout.name}_{signal.field}".upper() for signal in layout.signals]
    lines = "\n".join(f"    {name}," for name in (*names, f"{layout.name}_SIGNALS"))
    return f"extern const struct message {layout.name};\nenum {{\n{lines}\n}};"


def _table(layout: MessageLayout) -> str:
    """Return the tables of a message and its signals."""
    rows = "\n".join(f"    {_signal(signal)}," for signal in layout.signals)
    form = FD | BITRATE_SWITCH if layout.length > CLASSIC_LENGTH_MAX else 0
    fields = {
        "can_id": f"{layout.can_id:#x}",
        "data_id": f"{layout.data_id:#x}",
        "length": layout.length,
        "format": form,
        "count": len(layout.signals),
        "cycle_ns": _long(layout.cycle_time_ms * NS_PER_MS),
        "signals": f"{layout.name}_TABLE",
    }
    values = "\n".join(f"    .{name} = {value}," for name, value in fields.items())
    return (
        f"static const struct signal {layout.name}_TABLE[] = {{\n{rows}\n}};\n"
        f"const struct message {layout.name} = {{\n{values}\n}};\n"
    )


def _signal(it: SignalLayout) -> str:
    low, high = round(it.minimum / it.scale), round(it.maximum / it.scale)
    is_signed = str(it.is_signed).lower()
    return f"{{{it.start}, {it.length}, {is_signed}, {low}, {high}, {hexadecimal(it.scale)}}}"
