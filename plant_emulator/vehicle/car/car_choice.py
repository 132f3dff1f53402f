"""The car of a plant: which equations move it, by the type of its params.

A car of another package (``CarModel``) has a state of its own next to ``CarState``, which sensors,
steering, speed control and path read: that of a stability control, of roll, of a trailer.
"""

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any, NamedTuple

from ....runtime.settings import Settings
from ....runtime.settings.plugin import PartError, call_part, find_part
from .car_step import CarInput, CarParams, CarState, car_step


class CarModel(NamedTuple):
    """A car of another package; its constants and its own state are NamedTuples of numbers.

    ``params(built_in, own)``  returns its constants, of a type that no other car has;
                               ``built_in`` are those of [vehicle] and [car]
    ``start(params)``          returns its own state at the start
    ``step(params, car, own, inputs, h_s)``  returns CarState and own state after ``h_s`` > 0,
                               at most 1 ms
    ``settings``               model of the table [car.own]; None: it has none
    """

    params: Callable[[CarParams, Any], Any]
    start: Callable[[Any], Any]
    step: Callable[[Any, CarState, Any, CarInput, float], tuple[CarState, Any]]
    settings: type[Settings] | None = None


find_car_model = partial(find_part, kind=CarModel, noun="car model")
"""Returns the model at a place; raises ValueError."""


def _nothing(_params: CarParams) -> float:
    return 0.0


def _built_in_step(
    p: CarParams, x: CarState, own: Any, inputs: CarInput, h_s: float
) -> tuple[CarState, Any]:
    return car_step(p, x, inputs, h_s), own


BUILT_IN = CarModel(lambda built_in, _own: built_in, _nothing, _built_in_step)
CARS: dict[type, tuple[str, CarModel]] = {CarParams: ("the built-in car", BUILT_IN)}
"""By the type of the params; those of other packages once they have been designed."""


def drive_step(p: Any, x: CarState, own: Any, inputs: CarInput, h_s: float) -> tuple[CarState, Any]:
    """Return the state of the car and its own after ``h_s``; a model that fails: PartError."""
    what, model = CARS[type(p)]
    if model is BUILT_IN:
        return _built_in_step(p, x, own, inputs, h_s)
    car, own = call_part(what, model.step, p, x, own, inputs, h_s)
    for name, value in zip(CarState._fields, car, strict=True):
        if not isfinite(value):
            raise PartError(f"{what}: {name} = {value!r} is not a finite number")
    return car, own


def start_of_own(p: Any) -> Any:
    """Return the car's own state at the start."""
    _, model = CARS[type(p)]
    return model.start(p)


def own_car_params(place: str, built_in: CarParams, own: Any) -> Any:
    """Return the params of the car at a place, known by their type from now on.

    Raises PartError where they, or a first step, are not what ``CarModel`` says.
    """
    what, model = f"car model {place}", find_car_model(place)
    params: Any = call_part(what, model.params, built_in, own)
    kind = type(params)
    _, known = CARS.get(kind, (what, model))
    is_anothers = (known.start, known.step) != (model.start, model.step)
    if is_anothers or not hasattr(kind, "_fields"):
        raise PartError(f"{what}: params must be a NamedTuple of its own, not {kind.__name__}")
    at = CarState(1.0, *[0.0] * (len(CarState._fields) - 1))
    inputs = CarInput(0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    start = call_part(what, model.start, params)
    after = call_part(what, model.step, params, at, start, inputs, 0.001)
    if not isinstance(after, tuple) or [*map(type, after)] != [CarState, type(start)]:
        raise PartError(f"{what}: a step must return a CarState, and a state as that at the start")
    CARS[kind] = what, model
    return params
