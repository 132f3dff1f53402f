"""The record of a law: all that the rest of the program knows of it.

A law is one module that ends with its record, and ``controller.laws`` finds the module. Settings,
node, ``--check`` and compiled runs use only the record.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from ...dbc.messages import LawNumber
from ...runtime.settings import Settings
from .law import LawInput, LawOutput

LawStep = Callable[[Any, Any, LawInput], tuple[Any, LawOutput]]
LawPlan = Callable[[Any, Any, LawInput], int]


class Schedule(NamedTuple):
    """Params of a law that depend on the speed; ``at`` returns them for a speed [m/s]."""

    at: Callable[[float], Any]


class Fallback(NamedTuple):
    """The law that takes over from another one, and a text that describes when."""

    law: str
    when: str


class LookingBack(NamedTuple):
    """How ``--check`` analyses a law that is linear only while the latency is constant.

    ``opening``, ``closing``  lines before and after the analysis
    ``state_period_ns``  period of VEHICLE_STATE [ns]; None: the law does not read it
    ``request_periods``  control periods after which the law repeats itself
    """

    opening: tuple[str, ...]
    closing: tuple[str, ...] = ()
    fallback: Fallback | None = None
    state_period_ns: int | None = None
    request_periods: int = 1


class Law(NamedTuple):
    """A law; ``Any`` stands for its own params and state, both NamedTuples of numbers, and for the
    settings, ``law_settings.LawSettings``, which contain the law.

    ``step``      ``step(params, state, LawInput) -> (state, LawOutput)``: one control period
    ``at_rest``   state after a constant lateral error [m] and no steering, from the params
    ``design``    params from the settings; a ``Schedule`` where they depend on the speed
    ``number``    its code on the bus
    ``settings``  model of the law's own table, which is named after the law
    ``needs``     other tables that the law requires
    ``schedules_demand`` whether its gains follow the speed beyond [validity] too
    ``needs_vehicle``    whether [nominal_model] has to be of kind 'vehicle'
    ``cutoffs``          keys of its own table that have to be below the Nyquist frequency
    ``looks_back``       whether the law reads more than the first two fields of its ``LawInput``;
                         if not, no history of the bus is kept
    ``takes_derivative`` whether the law feeds the lateral error through C(s) of [pd], whose
                         derivative may then be the Kalman filter's
    ``feed_forward_refusal``  why [feed_forward] must not be added; empty: it may be
    ``commands_read``    for a law that is linear in the lateral error and its own last commands:
                         returns the number of these commands from the params; None: not linear
    ``looking_back``     analysis of a law that is linear at a constant latency only
    ``after_hold``       state after a hold, from the params, the state before the hold and the
                         lateral error now [m]; None: the law starts anew
    ``plan``             for a law that plans: writes the plan of this period into the history's
                         ``plans``, from the params, the state after the step and its input, and
                         returns the index of the value that acts first, -1 for no plan
    ``single_commands``  the law in place of one that plans, on classic CAN
    """

    step: LawStep
    at_rest: Callable[[Any, float], Any]
    design: Callable[[Any], Any]
    number: LawNumber = LawNumber.CUSTOM
    settings: type[Settings] | None = None
    needs: tuple[str, ...] = ()
    schedules_demand: bool = False
    needs_vehicle: bool = False
    cutoffs: tuple[str, ...] = ()
    looks_back: bool = False
    takes_derivative: bool = False
    feed_forward_refusal: str = ""
    commands_read: Callable[[Any], int] | None = None
    looking_back: Callable[[Any, Any], LookingBack | None] | None = None
    after_hold: Callable[[Any, Any, float], Any] | None = None
    plan: LawPlan | None = None
    single_commands: str = ""


def last_command(_params: Any) -> int:
    """Return the number of commands that a law reads if it reads ``sent_steer_rad`` only."""
    return 1
