"""node_rules.c and node_rules.h: what the node around a law takes from Python.

These are the node's rules, as functions; their parameters, from the settings; and its messages.
``node/`` has the C that is written by hand, and ``closed_loop/lockstep`` the protocol with its two
machines. Those are copied, so that the folder needs nothing else.
"""

from collections.abc import Callable, Iterator
from importlib.resources import files
from math import ceil
from typing import Any

from steer_by_wire.controller.age_limits import freshness
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.limits.designed_ranges import (
    NOT_FORWARD_M_S,
    share_of_demand,
    validity_of,
)
from steer_by_wire.controller.node import modes
from steer_by_wire.controller.node.command_frames import IN_FLIGHT_MAX, echoed_age
from steer_by_wire.controller.node.law_runner import FAILURES_MAX
from steer_by_wire.controller.node.model_fit import FitParams, fit_params, fit_step, start_fit
from steer_by_wire.controller.node.newest_messages import RECEIVED, acting_rad
from steer_by_wire.controller.node.reported_delay import (
    delay_status,
    echo_delay_s,
    echo_rule,
    echo_step,
)
from steer_by_wire.controller.node.safety_alarms import LOST_COUNTERS, facts_of, is_report_due
from steer_by_wire.controller.node.status_frames import STATUS_PERIOD_NS, controller_status
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.codec.counter_rule import counter_step, start_counters
from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.codec.second_sender import sender_step, start_senders
from steer_by_wire.dbc.messages import COMMAND_COUNTERS, DelayStatus, limits
from steer_by_wire.dbc.reception import cycle_ns, second_sender_at
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.overruns import (
    counted_periods,
    keeps_rate,
    overrun_rule,
    overrun_step,
)
from steer_by_wire.runtime.settings import SettingsError

from .functions import Function
from .helpers import called_by
from .line_width import folded
from .messages import messages_in_c
from .records import Records, declared, enumeration, hexadecimal, initializer, struct
from .sources import reached, records_of

NAME = "node_rules"
_PROTOCOL = "steer_by_wire.closed_loop.lockstep"
_RULES: tuple[Callable[..., Any], ...] = (
    *(modes.mode_step, modes.measured_run, modes.damaged_run),
    *(counted_periods, overrun_step, keeps_rate),
    *(start_counters, counter_step, start_senders, sender_step),
    *(freshness, acting_rad, share_of_demand),
    *(echoed_age, echo_step, echo_delay_s, delay_status),
    *(start_fit, fit_step, validity_of),
    *(second_sender_at, facts_of, is_report_due, controller_status),
)
_HEADER = """\
/* {title}
 *
 * The rules of the node around the law, their parameters, and its messages.
 */
#ifndef NODE_RULES_H
#define NODE_RULES_H

#include <stdbool.h>
#include <stdint.h>

{defines}

{enums}
{structs}
{parameters}
{prototypes}

{messages}
#endif
"""
_SOURCE = """\
/* {title} */
#include "node_rules.h"

{parameters}
{helpers}
{definitions}
{messages}"""


_DELAY_S_MAX = limits(DelayStatus)["echo_delay_s"].maximum
_ANY_VEHICLE = NominalVehicle(*(1.0,) * len(NominalVehicle._fields))
"""Of settings that state no vehicle, whose fit is not judged."""


def node_source(settings: ControllerSettings, title: str) -> dict[str, str]:
    """Return the texts of all files but the law's, by their names.

    Raises SettingsError for settings that the node in C does not know.
    """
    if settings.supervision.second_sender == "silent":
        raise SettingsError('supervision.second_sender = "silent" does not become C: leave it out')
    if settings.supervision.stops_if_implausible is True:
        raise SettingsError("supervision.stops_if_implausible does not become C: leave it out")
    sources = reached(_RULES)
    records = records_of(sources)
    functions = [(source.function, Function(source, records)) for source in sources]
    definitions = "\n".join(
        function.definition("" if rule in _RULES else "static ") for rule, function in functions
    )
    parameters = [_definition(*it, records) for it in _parameters(settings)]
    message_declarations, message_definitions = messages_in_c(records)
    header = _HEADER.format(
        title=title,
        defines="\n".join(f"#define {name} {value}" for name, value in _defines(settings)),
        enums="\n".join(map(enumeration, records.enums)),
        structs="\n".join(map(struct, records.made)),
        parameters="\n".join(f"extern const {it};" for it, _ in parameters),
        prototypes="\n".join(f"{it.prototype()};" for rule, it in functions if rule in _RULES),
        messages=message_declarations,
    )
    source = _SOURCE.format(
        title=title,
        parameters="\n".join(f"const {it} = {value};\n" for it, value in parameters),
        helpers=called_by(definitions + message_definitions),
        definitions=definitions,
        messages=message_definitions,
    )
    by_hand = {
        file.name: file.read_text(encoding="utf-8")
        for folder in (files(__package__) / "node", files(_PROTOCOL))
        for file in folder.iterdir()
        if file.is_file() and not file.name.endswith(".py")
    }
    return {f"{NAME}.h": folded(header), f"{NAME}.c": folded(source), **by_hand}


def commands_in_flight(settings: ControllerSettings) -> int:
    """Return of how many commands the node in C keeps the sending time.

    It covers twice the longest delay that the settings are designed for, so that a longer one is
    noticed; or the longest that DELAY_STATUS reports, where they state none.
    """
    delay_s = 2e-3 * settings.validity.delay_ms_max if settings.validity else _DELAY_S_MAX
    return min(ceil(delay_s * NS_PER_S / settings.period_ns) + 1, IN_FLIGHT_MAX)


def _defines(settings: ControllerSettings) -> Iterator[tuple[str, str]]:
    rule = overrun_rule(settings.overruns)
    yield "LAW_NUMBER", str(int(settings.law_record.number))
    yield "IN_FLIGHT", str(commands_in_flight(settings))
    yield "OVERRUN_WINDOW_TICKS", str(rule.window_ticks)
    yield "MISSED_WINDOW_PERIODS", str(rule.window_periods)
    yield "STATUS_PERIOD_NS", str(STATUS_PERIOD_NS)
    yield "COMMAND_COUNTERS", str(COMMAND_COUNTERS)
    yield "COUNTERS", str(COUNTERS)
    yield "LOST_COUNTERS", str(LOST_COUNTERS)
    yield "LAW_FAILURES_MAX", str(FAILURES_MAX)
    yield "NOT_FORWARD_M_S", hexadecimal(NOT_FORWARD_M_S)
    yield "HAS_MODEL_FIT", str(int(fit_params(settings) is not None))


def _parameters(settings: ControllerSettings) -> Iterator[tuple[str, Any]]:
    """Yield the constants of the generated file, with their values in Python."""
    yield "SUPERVISION", modes.supervision_of(settings)
    yield "OVERRUN_RULE", overrun_rule(settings.overruns)
    yield "DESIGNED_RANGES", settings.designed_ranges
    yield "ECHO_RULE", echo_rule(settings)
    yield "FIT_PARAMS", fit_params(settings) or FitParams(1.0, 0.0, 1.0, _ANY_VEHICLE)
    yield "AGE_LIMITS_NS", [*settings.age_limits]
    rules = [settings.counters._replace(period_ns=cycle_ns(kind)) for kind in RECEIVED]
    yield "COUNTER_RULES", rules


def _definition(name: str, value: Any, records: Records) -> tuple[str, str]:
    """Return the declaration of a parameter, and its value; a list is an array."""
    values = value if isinstance(value, list) else [value]
    kind = records.kind_of(type(values[0]))
    texts = [initializer(kind, each) for each in values]
    if values is not value:
        return f"{declared(kind)} {name}", texts[0]
    return f"{declared(kind)} {name}[{len(values)}]", f"{{{', '.join(texts)}}}"
