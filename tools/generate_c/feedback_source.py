"""feedback_law.c and feedback_law.h: a feedback law of a hand wheel, from its settings."""

from typing import Any

from steer_by_wire.hand_wheel.feedback_laws import (
    FEEDBACK_AT_REST,
    FEEDBACK_LAWS,
    FeedbackInput,
    FeedbackParams,
    FeedbackState,
    resist,
)
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.runtime.settings.toml_text import dump_toml

from .functions import Function
from .helpers import called_by
from .law_source import structs, within_comment
from .line_width import folded
from .records import declared, initializer, parts_of
from .sources import reached, records_of

NAME = "feedback_law"
_HEADER = """\
/* {title}
 *
 *     feedback_start(&law);
 *     torque_n_m = feedback_step(&law, &input);      once in each cycle of CYCLE_NS
 *
 * The torque is that of the motor, to the left positive. Compile with -ffp-contract=off.
 */
#ifndef FEEDBACK_LAW_H
#define FEEDBACK_LAW_H

#define CYCLE_NS {cycle_ns}

{structs}
void feedback_start(struct feedback_state *law);
double feedback_step(struct feedback_state *law, const struct feedback_input *input);

#endif
"""
_SOURCE = """\
/* {title}
 *
{settings}
 */
#include "feedback_law.h"

{structs}
static const struct feedback_params PARAMS = {values};
static const struct feedback_state AT_REST = {at_rest};

{helpers}
{definitions}
void feedback_start(struct feedback_state *law)
{{
    *law = AT_REST;
}}

double feedback_step(struct feedback_state *law, const struct feedback_input *input)
{{
    const {result} made = {step}(&PARAMS, law, input);
    const {result} result = resist(&PARAMS, &made.first, made.second, input->rate_rad_s);

    *law = result.first;
    return result.second;
}}
"""


def feedback_source(settings: HandWheelSettings, origin: str) -> dict[str, str]:
    """Return the texts of the two files by their names; ``origin``: of the settings."""
    law = settings.feedback.law
    title = f"Feedback law {law}, generated from {origin}: do not edit."
    step: Any = FEEDBACK_LAWS[law].step
    sources = reached([step, resist])
    records = records_of(sources)
    functions = [Function(source, records) for source in sources]
    definitions = "\n".join(each.definition("static ") for each in functions)
    of_params, of_state, of_input = (
        records.kind_of(kind) for kind in (FeedbackParams, FeedbackState, FeedbackInput)
    )
    shown = parts_of(of_state) | parts_of(of_input)
    header = _HEADER.format(
        title=title,
        cycle_ns=settings.cycle_ns,
        structs=structs(it for it in records.made if it in shown),
    )
    source = _SOURCE.format(
        title=title,
        settings=within_comment(dump_toml(settings)),
        structs=structs(it for it in records.made if it not in shown),
        values=initializer(of_params, settings.feedback_params),
        at_rest=initializer(of_state, FEEDBACK_AT_REST),
        helpers=called_by(definitions),
        definitions=definitions,
        step=step.__name__,
        result=declared(functions[-1].result),
    )
    return {f"{NAME}.c": folded(source), f"{NAME}.h": folded(header)}
