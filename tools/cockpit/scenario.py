"""Scenario on the lanes: laws, vehicle, path, seed and network, as a page chooses them."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, field_validator

from ...closed_loop.pair.with_hand_wheel import with_hand_wheel
from ...controller.settings import PRESETS as CONTROLLER_PRESETS
from ...controller.settings import ControllerSettings, controller_preset
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.wheel import GRIPS
from ...plant_emulator.network.latency_distributions import Distribution
from ...plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
from ...plant_emulator.path.path import Path
from ...plant_emulator.path.settings import PathModel
from ...plant_emulator.settings import PRESETS as PLANT_PRESETS
from ...plant_emulator.settings import PlantSettings, plant_preset
from ...runtime.settings import Settings, SettingsError, preset_names, with_values
from .orders import HAND_WHEELS, HANDS_OFF

LANES_MAX = 4
HAND = "hand"
"""In place of a controller's preset: the visitor steers."""
CARS = ("bmw_320i", "large_sedan", "city_bus", "f1tenth")
"""Vehicles to choose from where the visitor drives."""
ICE_FRICTION = 0.3
"""What the button for ice asks for."""
_ENDLESS_S = 1e6
"""The longest run that there is: eleven days."""

PATHS: Mapping[str, Mapping[str, Any] | None] = {
    "as in the preset": None,
    "ellipse 60 by 30 m": {"kind": "ellipse", "semi_major_axis_m": 60.0, "semi_minor_axis_m": 30.0},
    "ellipse 24 by 14 m": {"kind": "ellipse", "semi_major_axis_m": 24.0, "semi_minor_axis_m": 14.0},
    "circle, radius 50 m": {"kind": "circle", "radius_m": 50.0},
    "single lane change": {"kind": "single_lane_change", "start_m": 20.0},
    "double lane change": {"kind": "double_lane_change", "start_m": 20.0, "length_m": 90.0},
    "straight": {"kind": "straight"},
    "winding road": {"kind": "own", "model": "steer_by_wire.tools.cockpit.scenario:WINDING_ROAD"},
}
_STRAIGHT_M = 40.0
_LENGTH_M = 6000.0
"""Ten minutes at 36 km/h; then it goes straight on."""
_POINT_M = 5.0
_WAVES = ((0.010, 110.0), (0.006, 67.0))
"""Curvature [1/m] and length [m] of the waves that add up to the bends."""
_PAGE = "the page"
_ANY_LAW = "practical_pd_ddob"


class Latency(Settings):
    """The latency of one direction."""

    model: Literal["constant", "uniform", "normal", "lognormal", "gamma"] = "normal"
    mean_s: Annotated[float, Field(ge=0.0, le=2.0)] = 0.0
    spread_s: Annotated[float, Field(ge=0.0, le=2.0)] = 0.0
    loss: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Scenario(Settings):
    """One run of up to four pairs under the same seed.

    ``controllers``  a preset of the controller for each lane, or the hand
    ``is_round``     whether it belongs to the guided rounds
    ``plant``        preset of the plant: the vehicle, a corner of the uncertainty box
    ``plants``       one a lane instead; the last for those beyond
    ``speed_km_h``   None: that of the preset
    ``driven_to_km_h``  the visitor drives from standstill to at most this; None: ``speed_km_h``
    ``wheel_cycle_ms``, ``torque_gradient_n_m``, ``grip``  of a hand wheel, and how it is held
    """

    title: str = ""
    note: str = ""
    is_round: bool = False
    controllers: Annotated[tuple[str, ...], Field(min_length=1, max_length=LANES_MAX)]
    plant: str = "paper_nominal"
    plants: tuple[str, ...] = ()
    wheel_cycle_ms: Annotated[float, Field(ge=1.0, le=20.0)] = 5.0
    torque_gradient_n_m: Annotated[float, Field(ge=0.0, le=100.0)] = 6.0
    grip: Literal["hands_off", "loose", "light", "firm"] = "light"
    path: str = "ellipse 60 by 30 m"
    speed_km_h: Annotated[float, Field(ge=0.5, le=250.0)] | None = None
    driven_to_km_h: Annotated[float, Field(ge=1.0, le=250.0)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**53)] = 1
    sensor_period_ms: Annotated[float, Field(ge=1.0, le=100.0)] = 10.0
    downlink: Latency = Latency()
    uplink: Latency = Latency()

    @field_validator("path")
    @classmethod
    def _is_a_path(cls, path: str) -> str:
        if path not in PATHS:
            raise ValueError(f"must be one of {', '.join(PATHS)}, not {path}")
        return path


class LaneSettings(NamedTuple):
    """What the two programs of a lane run with; without ``controller`` the hand steers."""

    label: str
    plant: PlantSettings
    controller: ControllerSettings | None
    hand_wheel: HandWheelSettings | None = None

    @property
    def is_driven(self) -> bool:
        """Whether the visitor sets the speed: the car has a profile, from standstill."""
        return self.controller is None and self.plant.car is not None and bool(self.plant.car.speed)


def scenarios() -> Sequence[Scenario]:
    """Return the list of presets that one click starts."""
    file = resources.files(__package__).joinpath("scenarios.toml")
    tables = tomllib.loads(file.read_text(encoding="utf-8"))["scenario"]
    return [scenario_of(table, file.name) for table in tables]


def scenario_titled(title: str | None) -> Scenario:
    """Return the preset of a title, the first one by default; raises SettingsError."""
    by_title = {scenario.title: scenario for scenario in scenarios()}
    title = title or next(iter(by_title))
    if title not in by_title:
        raise SettingsError(f"no scenario {title!r}; there are: {', '.join(by_title)}")
    return by_title[title]


def scenario_of(values: Mapping[str, Any], source: str = _PAGE) -> Scenario:
    """Return the scenario that ``values`` describe; raises SettingsError naming ``source``."""
    given = {key: value for key, value in values.items() if value is not None}
    return with_values(Scenario(controllers=(_ANY_LAW,)), given, source)


def lane_settings(scenario: Scenario) -> Sequence[LaneSettings]:
    """Return the settings of every lane; raises SettingsError."""
    plants = scenario.plants or (scenario.plant,)
    lanes = []
    for number, name in enumerate(scenario.controllers):
        plant_name = plants[min(number, len(plants) - 1)]
        plant, label = _plant_settings(scenario, plant_name), name.replace("_", " ")
        if scenario.plants:
            label = plant_name.replace("_", " ")
        if name in HAND_WHEELS:
            lanes.append(_with_hand_wheel(label, plant, scenario, HAND_WHEELS[name]))
        else:
            driver = None if name == HAND else controller_preset(name)
            lanes.append(LaneSettings(label, plant, driver))
    return lanes


def _with_hand_wheel(
    label: str, plant: PlantSettings, scenario: Scenario, feedback: Mapping[str, Any]
) -> LaneSettings:
    kicks = [
        {"at_s": 5.0 + 12.0 * number, "torque_n_m": -3.0 if number % 2 else 3.0}
        for number in range(500)
    ]
    values = {
        "cycle_ms": scenario.wheel_cycle_ms,
        "driver": {"grip": HANDS_OFF, "kicks": kicks},
        "feedback": {**feedback, "torque_gradient_n_m": scenario.torque_gradient_n_m},
    }
    wheel = with_values(HandWheelSettings(), values, scenario.title or _PAGE)
    plant, _, wheel = with_hand_wheel(plant, controller_preset(_ANY_LAW), wheel)
    return LaneSettings(label, plant, None, wheel)


def choices() -> Mapping[str, Any]:
    """Return what a page can choose from, ready for JSON."""
    return {
        "controllers": [HAND, *HAND_WHEELS, *preset_names(CONTROLLER_PRESETS)],
        "grips": list(GRIPS),
        "cars": CARS,
        "plants": preset_names(PLANT_PRESETS),
        "paths": list(PATHS),
        "models": [model.value for model in Distribution],
        "lanes_max": LANES_MAX,
        "ice_friction": ICE_FRICTION,
        "scenarios": [scenario.model_dump(mode="json") for scenario in scenarios()],
    }


def _plant_settings(scenario: Scenario, name: str) -> PlantSettings:
    values: dict[str, Any] = {
        "duration_s": _ENDLESS_S,
        "seed": scenario.seed,
        "interventions": "allow",
        "ground_truth": True,
        "sensor_period_ms": scenario.sensor_period_ms,
        "latency.downlink": _latency_table(scenario.downlink),
        "latency.uplink": _latency_table(scenario.uplink),
        # The step far behind the end makes the plant compute ice at its start, and not when it is
        # asked for it: that takes it a few sensor periods.
        "disturbance.steps": [{"at_s": _ENDLESS_S, "friction": ICE_FRICTION}],
    }
    path = PATHS.get(scenario.path)
    if path is not None:
        values["path"] = path
    if scenario.speed_km_h is not None:
        values["vehicle.speed_m_s"] = scenario.speed_km_h / 3.6
    preset = plant_preset(name)
    if scenario.driven_to_km_h is not None and preset.car is not None:
        speeds_m_s = (0.0, scenario.driven_to_km_h / 3.6)
        values |= {
            "car.speed": [{"at_s": at_s, "speed_m_s": it} for at_s, it in enumerate(speeds_m_s)],
            # They are set for one speed; here the tyres alone are the limit.
            "safety.lateral_acceleration_m_s2_max": "off",
            "safety.lateral_jerk_m_s3_max": "off",
        }
    return with_values(preset, values, scenario.title or _PAGE)


def _latency_table(latency: Latency) -> Mapping[str, Any]:
    table = latency.model_dump(mode="json")
    return table if latency.model != "constant" else {**table, "spread_s": 0.0}


def winding_road(_own: None) -> Path:
    """Return the road to drive by hand: a straight, then bends, gentle enough for 40 km/h.

    The bends are sums of sines, of at most 0.016 1/m.
    """
    count = round(_LENGTH_M / _POINT_M)
    bends = [
        (
            _STRAIGHT_M + number * _POINT_M,
            sum(k * math.sin(math.tau * number * _POINT_M / length) for k, length in _WAVES),
        )
        for number in range(count)
    ]
    return path_of_curvature([*bends, (_STRAIGHT_M + _LENGTH_M, 0.0)])


WINDING_ROAD = PathModel(winding_road)
