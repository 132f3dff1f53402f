"""steering_law.c and steering_law.h: a law with its limits and fades, from the settings.

What becomes C: the law's step and its state at rest, the step of the set point for another
followed point than the preview point, ``limit_step``, ``difference_step``, ``ramp_step``, and every
function that these call.
"""

from collections.abc import Callable, Iterable
from typing import Any

from steer_by_wire.controller.law_interface import LawOutput, VehicleReading
from steer_by_wire.controller.laws.law_from_settings import vehicle_of
from steer_by_wire.controller.laws.pid import PidSettings, pid_error_step, pid_step
from steer_by_wire.controller.laws.set_point import (
    NO_SET_POINT,
    SetPointParams,
    SetPointState,
    set_point_params,
    set_point_step,
)
from steer_by_wire.controller.limits.fades_and_ramps import difference_step, ramp_step
from steer_by_wire.controller.limits.steer_limits import SteerLimits, limit_step
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.runtime.settings.toml_text import dump_toml

from .functions import Function
from .helpers import called_by
from .line_width import folded
from .records import Record, Records, declared, hexadecimal, initializer, parts_of, struct
from .sources import reached, records_of

LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob", "pid")
NAME = "steering_law"
_PUBLIC: tuple[Callable[..., float], ...] = (limit_step, difference_step, ramp_step)
_AROUND = (
    *("set_point_state", "set_point_params", "starts_set_point"),
    *("moves_set_point", "less_set_point"),
)
"""Places of the two texts that a set point fills."""
_NOT_IN_C = ("estimator",)
"""Tables that neither these laws nor the node around them read."""
_HEADER = """\
/* {title}
 *
 *     law_start(&law, error_m);                      the law begins, or begins again
 *     output = law_step(&law, error_m, sent_rad, &vehicle);   once in each period of PERIOD_NS
 *     sent_rad = limit_step(&STEER_LIMITS, sent_rad, output.steer_rad);
 *
 * Compile with -ffp-contract=off: a fused multiplication rounds once where Python rounds twice.
 */
#ifndef STEERING_LAW_H
#define STEERING_LAW_H

#include <stdbool.h>

#define PERIOD_NS {period_ns}

{structs}
/* What the law keeps from one period to the next. */
struct law {{
    {state} state;{set_point_state}
}};

extern const {limits} STEER_LIMITS;
extern const double RAMP_STEP_RAD; /* of a fade or a ramp in one period */

void law_start(struct law *law, double lateral_error_m);
struct law_output law_step(struct law *law, double lateral_error_m, double sent_steer_rad,
                           const struct vehicle_reading *vehicle);
{prototypes}

#endif
"""
_SOURCE = """\
/* {title}
 *
{settings}
 */
#include "steering_law.h"

#include <float.h>

{structs}
static const {params} PARAMS = {values};
{set_point_params}
const {limits} STEER_LIMITS = {limit_values};

const double RAMP_STEP_RAD = {ramp_step_rad};

{helpers}
{definitions}
void law_start(struct law *law, double lateral_error_m)
{{
    law->state = {at_rest}(&PARAMS, lateral_error_m);
{starts_set_point}}}

struct law_output law_step(struct law *law, double lateral_error_m, double sent_steer_rad,
                           const struct vehicle_reading *vehicle)
{{
    {moves_set_point}
    const struct law_input observed = {{
        lateral_error_m{less_set_point}, sent_steer_rad,
    }};
    const {result} result = {step}(&PARAMS, &law->state, &observed);

    law->state = result.first;
    return result.second;
}}
"""


def title_of(settings: ControllerSettings, origin: str) -> str:
    """Return the first line of a file that is generated from settings of this origin."""
    return f"Law {settings.law} at {settings.rate_hz:g} Hz, generated from {origin}: do not edit."


def law_source(settings: ControllerSettings, title: str) -> dict[str, str]:
    """Return the texts of the law's two files by their names, each with its first line.

    Raises UserError for a law that does not become C.
    """
    law, params, law_step = settings.law_record, params_of(settings), step_of(settings)
    set_point = _set_point_of(settings)
    sources = reached([law.at_rest, law_step, set_point_step, *_PUBLIC])
    records = records_of(sources)  # the vehicle's too, which every law is given
    if set_point is None:
        sources = reached([law.at_rest, law_step, *_PUBLIC])
    functions: dict[Callable[..., Any], Function] = {
        source.function: Function(source, records) for source in sources
    }
    definitions = [
        translated.definition("" if function in _PUBLIC else "static ")
        for function, translated in functions.items()
    ]
    step, at_rest = functions[law_step], functions[law.at_rest]
    of_params, of_state, _ = (kind for _, kind in step.parameters)
    of_output, of_limits = records.kind_of(LawOutput), records.kind_of(SteerLimits)
    of_vehicle = records.kind_of(VehicleReading)
    shown = parts_of(of_state) | parts_of(of_output) | parts_of(of_limits) | parts_of(of_vehicle)
    around = dict.fromkeys(_AROUND, "") | {"moves_set_point": "(void)vehicle;"}
    if set_point is not None:
        shown |= parts_of(records.kind_of(SetPointState))
        around = _with_set_point(set_point, records)
    header = _HEADER.format(
        title=title,
        limits=declared(of_limits),
        period_ns=settings.period_ns,
        structs=structs(it for it in records.made if it in shown),
        state=declared(of_state),
        set_point_state=around.pop("set_point_state"),
        prototypes="\n".join(f"{functions[it].prototype()};" for it in _PUBLIC),
    )
    source = _SOURCE.format(
        title=title,
        limits=declared(of_limits),
        settings=within_comment(dump_toml(settings, _NOT_IN_C)),
        structs=structs(it for it in records.made if it not in shown),
        params=declared(of_params),
        values=initializer(of_params, params),
        limit_values=initializer(of_limits, settings.steer_limits),
        ramp_step_rad=hexadecimal(settings.supervision.ramp_rad_s * settings.period_ns / NS_PER_S),
        helpers=called_by("".join(definitions)),
        definitions="\n".join(definitions),
        at_rest=at_rest.name,
        step=step.name,
        result=declared(step.result),
        **around,
    )
    return {f"{NAME}.c": folded(source), f"{NAME}.h": folded(header)}


def step_of(settings: ControllerSettings) -> Any:
    """Return the function that becomes the law's step: it reads no more than the lateral error."""
    step = settings.law_record.step
    return pid_error_step if step is pid_step else step


def params_of(settings: ControllerSettings) -> Any:
    """Return the law's params; raises SettingsError for a law that stays in Python."""
    if settings.law not in LAWS:
        raise SettingsError(f"law = {settings.law!r} does not become C: {', '.join(LAWS)} do")
    for key, is_there in {
        "[feed_forward]": settings.feed_forward is not None,
        "pid.heading_gain_rad_rad": settings.law == "pid"
        and settings.table_of(PidSettings).heading_gain_rad_rad is not None,
    }.items():
        if is_there:
            raise SettingsError(f"{key} does not become C: leave it out")
    params = settings.law_record.design(settings)
    try:
        settings.law_record.at_rest(params, 1.0)
    except ValueError as error:
        raise SettingsError(f"law = {settings.law!r}: {error}") from error
    return params


def _set_point_of(settings: ControllerSettings) -> SetPointParams | None:
    if settings.followed_point == "preview":
        return None
    return set_point_params(settings.followed_point, vehicle_of(settings), settings.period_s)


def _with_set_point(p: SetPointParams, records: Records) -> dict[str, str]:
    of_params, of_state = records.kind_of(SetPointParams), records.kind_of(SetPointState)
    state = declared(of_state)
    texts = (
        f"\n    {state} set_point;",
        f"static const {declared(of_params)} SET_POINT = {initializer(of_params, p)};\n"
        f"static const {state} NO_SET_POINT = {initializer(of_state, NO_SET_POINT)};\n",
        "    law->set_point = NO_SET_POINT;\n",
        "law->set_point = set_point_step(&SET_POINT, &law->set_point, vehicle);",
        " - law->set_point.shown.value",
    )
    return dict(zip(_AROUND, texts, strict=True))


def structs(records: Iterable[Record]) -> str:
    """Return the definitions of structs."""
    return "\n".join(map(struct, records))


def within_comment(text: str) -> str:
    """Return lines as those of a comment."""
    return "\n".join(f" * {line}".rstrip() for line in text.splitlines())
