"""Design of a law from its settings: its own, and the additions around it."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ...dbc.messages import LawNumber
from ...runtime.settings import SettingsError
from ..filters.settings import VehicleModelSettings
from ..law_interface import Law, LawPlan, LawStep, LookingBack, Schedule, VehicleBelief
from ..limits.fades_and_ramps import FADE_RAD_S
from .feed_forward import FeedForwardParams, SteadySteer, feed_forward_at_rest, feed_forward_step
from .law_guard import Guard
from .set_point import (
    FollowedPointParams,
    followed_point_after_hold,
    followed_point_at_rest,
    followed_point_plan,
    followed_point_step,
    set_point_params,
)

if TYPE_CHECKING:
    from .settings import LawSettings

_Table = TypeVar("_Table")


class LawDesign(NamedTuple):
    """A law ready to run: the functions of its record (``Law``) with settings and params filled in.

    ``params``         of a law scheduled on speed, those at the lowest speed
    ``initial_state``  the record's ``at_rest``, and ``recovered_state`` its ``after_hold``
    ``looks_back``     whether it reads more than the first two fields of its ``LawInput``, and
    ``reads_history``  more than those and speed, curvature and staleness of the vehicle
    ``params_at``      of a law scheduled on speed: its params at a speed [m/s]; else None
    ``asks_speed``     the speed not to be exceeded by the state [m/s]; None: never asks
    ``mistake``        the last exception of a law from another package; empty for none
    """

    params: Any
    initial_state: Callable[[float], Any]
    step: LawStep
    params_at: Callable[[float], Any] | None = None
    looks_back: bool = False
    reads_history: bool = False
    commands_read: int | None = 1
    heading_gain: float = 0.0
    recovered_state: Callable[[Any, float], Any] | None = None
    looking_back: LookingBack | None = None
    plan: LawPlan | None = None
    believes: Callable[[Any], VehicleBelief] | None = None
    mistake: Callable[[], str] = str
    asks_speed: Callable[[Any], float] | None = None


def design_law(settings: "LawSettings") -> LawDesign:
    """Return the law of the settings, discretised at their rate, with its additions around it."""
    law = settings.law_record
    design = _guarded(law, settings) if law.number is LawNumber.CUSTOM else _alone(law, settings)
    if settings.feed_forward is not None:
        design = _with_feed_forward(design, settings, settings.feed_forward.gain)
    if settings.followed_point != "preview" and law.number is not LawNumber.CUSTOM:
        design = _with_followed_point(design, settings)
    return design


def _alone(law: Law, settings: "LawSettings") -> LawDesign:
    designed = law.design(settings)
    params_at = designed.at if isinstance(designed, Schedule) else None
    params = designed if params_at is None else params_at(0.0)
    heading_gain = 0.0 if law.heading_gain is None else law.heading_gain(params)
    looks_back = law.looks_back or heading_gain != 0.0
    return LawDesign(
        params,
        partial(law.at_rest, params),
        law.step,
        params_at,
        looks_back,
        looks_back,
        None if law.commands_read is None else law.commands_read(params),
        heading_gain,
        None if law.after_hold is None else partial(law.after_hold, params),
        None if law.looking_back is None else law.looking_back(settings, params),
        law.plan,
        None if law.believes is None else partial(law.believes, settings),
        asks_speed=None if law.asks_speed is None else law.asks_speed(settings),
    )


def _guarded(law: Law, settings: "LawSettings") -> LawDesign:
    """Return a plug-in law, guarded so that its exceptions cannot end the controller.

    Raises SettingsError where its design fails.
    """
    guard = Guard()
    try:
        design = _alone(guard.around(law), settings)
    except SettingsError:
        raise
    except Exception as error:
        cause = f"{type(error).__name__}: {error}".splitlines()[0]
        raise SettingsError(f"law = {settings.law!r}: its design fails: {cause}") from error
    at = design.params_at
    return design._replace(
        params_at=None if at is None else guard.called(at), mistake=lambda: guard.mistake
    )


def _with_feed_forward(law: LawDesign, settings: "LawSettings", gain: float) -> LawDesign:
    steady, fade_step_rad = steady_steer(vehicle_of(settings), gain), FADE_RAD_S / settings.rate_hz
    around = _with_params(law, lambda inside: FeedForwardParams(inside, steady, fade_step_rad))
    return around._replace(
        initial_state=partial(feed_forward_at_rest, law.initial_state),
        step=partial(feed_forward_step, law.step),
    )


def _with_followed_point(law: LawDesign, settings: "LawSettings") -> LawDesign:
    """Return a law with a set point, so that another point than the preview point follows."""
    own = set_point_params(settings.followed_point, vehicle_of(settings), settings.period_s)
    around, recovered = _with_params(law, lambda each: FollowedPointParams(each, own)), None
    if law.recovered_state is not None:
        recovered = partial(followed_point_after_hold, law.recovered_state)
    believes, asks_speed = law.believes, law.asks_speed
    return around._replace(
        initial_state=partial(followed_point_at_rest, law.initial_state),
        step=partial(followed_point_step, law.step),
        recovered_state=recovered,
        plan=None if law.plan is None else partial(followed_point_plan, law.plan),
        believes=None if believes is None else lambda state: believes(state.law),
        asks_speed=None if asks_speed is None else lambda state: asks_speed(state.law),
    )


def _with_params(law: LawDesign, around: Callable[[Any], Any]) -> LawDesign:
    """Return a law with params around its own, which reads the vehicle."""
    at = law.params_at
    return law._replace(
        params=around(law.params),
        params_at=None if at is None else lambda speed_m_s: around(at(speed_m_s)),
        looks_back=True,
    )


def steady_steer(vehicle: VehicleModelSettings, gain: float = 1.0) -> SteadySteer:
    """Return the steer per curvature of a vehicle, times a gain."""
    c_f, c_r = vehicle.front_cornering_stiffness_n_rad, vehicle.rear_cornering_stiffness_n_rad
    l_f, l_r = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    wheelbase_m = l_f + l_r
    understeer_s2_m = vehicle.virtual_mass_kg * (c_r * l_r - c_f * l_f) / (c_f * c_r * wheelbase_m)
    return SteadySteer(gain * wheelbase_m, gain * understeer_s2_m)


def vehicle_of(settings: "LawSettings") -> VehicleModelSettings:
    """Return the nominal vehicle; the settings guarantee that there is one."""
    if not isinstance(settings.nominal_model, VehicleModelSettings):
        raise ValueError("the law needs a [nominal_model] of kind 'vehicle'")
    return settings.nominal_model


def required(table: _Table | None) -> _Table:
    """Return a table that the settings guarantee for their law."""
    if table is None:
        raise ValueError("the law needs a table that the settings do not have")
    return table
