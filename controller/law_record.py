"""The record that a law is: all that the rest of the program knows of it.

A law is one module that ends with its record. ``controller.laws`` finds the module, the settings,
the node, ``--check`` and the compiled runs follow from the record.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..dbc.messages import Law as LawNumber
from ..runtime.settings import Settings
from .law_interface import LawInput, LawOutput

if TYPE_CHECKING:
    from .law_settings import LawSettings

LawStep = Callable[[Any, Any, LawInput], tuple[Any, LawOutput]]


class Schedule(NamedTuple):
    """Params of a law that depend on the speed; ``at`` returns them for a speed [m/s]."""

    at: Callable[[float], Any]


class Fallback(NamedTuple):
    """The law that another one becomes, and when, in words."""

    law: str
    when: str


class LookingBack(NamedTuple):
    """How ``--check`` analyses a law that is linear only while the latency is constant.

    ``opening``, ``closing``  lines before and after the analysis
    ``state_period_ns``  from one VEHICLE_STATE to the next; None: the law does not read it
    ``request_periods``  control periods after which the law repeats itself
    """

    opening: tuple[str, ...]
    closing: tuple[str, ...] = ()
    fallback: Fallback | None = None
    state_period_ns: int | None = None
    request_periods: int = 1


class Law(NamedTuple):
    """A law; ``Any`` stands for its own params and state, both NamedTuples of numbers.

    ``step``      ``step(params, state, LawInput) -> (state, LawOutput)``: one control period
    ``at_rest``   state after a constant lateral error [m] and no steering, from the params
    ``design``    params from the settings; a ``Schedule`` where they depend on the speed
    ``number``    on the wire
    ``settings``  model of the law's own table, which is named after the law
    ``needs``     tables of other names that the law cannot do without
    ``needs_vehicle``    whether [nominal_model] has to be of kind 'vehicle'
    ``cutoffs``          keys of its own table that have to be below the Nyquist frequency
    ``looks_back``       whether the law reads more than the first two fields of its ``LawInput``;
                         where it does not, nothing is remembered of the wire
    ``takes_derivative`` whether the law feeds the lateral error through C(s) of [pd], whose
                         derivative may then be the Kalman filter's
    ``feed_forward_refusal``  why [feed_forward] must not be added; empty: it may be
    ``commands_read``    of a law that is linear, from the lateral error and its own last commands
                         alone: how many of these it reads, from the params; None: not linear
    ``looking_back``     of a law that is linear at a constant latency: its analysis
    ``after_hold``       state after a hold, from the params, the state before the hold and the
                         lateral error now [m]; None: the law starts anew
    """

    step: LawStep
    at_rest: Callable[[Any, float], Any]
    design: Callable[["LawSettings"], Any]
    number: LawNumber = LawNumber.CUSTOM
    settings: type[Settings] | None = None
    needs: tuple[str, ...] = ()
    needs_vehicle: bool = False
    cutoffs: tuple[str, ...] = ()
    looks_back: bool = False
    takes_derivative: bool = False
    feed_forward_refusal: str = ""
    commands_read: Callable[[Any], int] | None = None
    looking_back: Callable[["LawSettings", Any], LookingBack] | None = None
    after_hold: Callable[[Any, Any, float], Any] | None = None


def last_command(_params: Any) -> int:
    """Return how many commands a law reads that reads ``sent_steer_rad`` only."""
    return 1
