"""Every number of the settings has a range, which a mistake is answered with."""

import math
from collections.abc import Iterator

from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.settings.mistakes import Schema, schema_of

MODELS = (BusSettings, ControllerSettings, PlantSettings)
UNBOUNDED = {
    "FaultSettings.magnitude": "its range depends on the kind, see MAGNITUDES",
    "SpeedPoint.speed_m_s": "a speed below 0 is refused in a line of its own",
    "SupervisionSettings.ramp_rad_s": "any faster ramp is at zero within a period",
}
LOWER, UPPER = ("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum")


def numbers(schema: object) -> Iterator[Schema]:
    """Yield each number of a setting, those in lists and in alternatives too."""
    if isinstance(schema, dict):
        if schema.get("type") in ("integer", "number"):
            yield schema
        schema = list(schema.values())
    if isinstance(schema, list):
        for part in schema:
            yield from numbers(part)


def is_bounded(number: Schema) -> bool:
    return all(
        any(math.isfinite(number.get(key, math.inf)) for key in keys) for keys in (LOWER, UPPER)
    )


def test_every_number_of_the_settings_has_a_lower_and_an_upper_bound() -> None:
    tables: dict[str, Schema] = {}
    for model in MODELS:
        tables |= schema_of(model).get("$defs", {}) | {model.__name__: schema_of(model)}
    of_setting = {
        f"{table}.{name}": list(numbers(setting))
        for table, schema in tables.items()
        for name, setting in schema.get("properties", {}).items()
    }
    assert sum(map(len, of_setting.values())) > 150
    unbounded = {name for name, found in of_setting.items() if not all(map(is_bounded, found))}
    assert unbounded == UNBOUNDED.keys()
