"""A steer-by-wire emulator to build on: the names below are stable, everything else may change.

>>> import steer_by_wire
>>> run = steer_by_wire.simulate(controller="practical_pd", seed=7, duration_s=2.0)
>>> run.outcome, len(run.plant.time_s)
('complete', 200)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .closed_loop.reports.plot_style import law_styles
    from .closed_loop.scripting.check import Check, check
    from .closed_loop.scripting.simulate import controller_presets, plant_presets, simulate
    from .closed_loop.scripting.simulated_run import ControllerTable, PlantTable, Run, Track
    from .closed_loop.studies.run_study import run_study, sweep
    from .controller.laws import Law, LawInput, LawOutput
    from .controller.settings import ControllerSettings
    from .dbc.messages import Mode
    from .hand_wheel.analysis.wheel_alone import FeedbackStability, feedback_stability
    from .plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
    from .plant_emulator.path.settings import PathModel
    from .plant_emulator.path.waypoints import path_through
    from .plant_emulator.settings import PlantSettings
    from .plant_emulator.vehicle.car.car_choice import CarModel
    from .plant_emulator.vehicle.car.car_step import CarInput, CarParams, CarState, car_step
    from .plant_emulator.vehicle.settings import VehicleInput, VehicleModel, VehicleState
    from .plant_emulator.vehicle.single_track_model import VehicleParams
    from .runtime.settings import Settings, SettingsError

__version__ = "0.1.0"

_NAMES = {
    "controller.laws": ("Law", "LawInput", "LawOutput"),
    "controller.settings": ("ControllerSettings",),
    "dbc.messages": ("Mode",),
    "hand_wheel.analysis.wheel_alone": ("FeedbackStability", "feedback_stability"),
    "plant_emulator.path.settings": ("PathModel",),
    "plant_emulator.path.ellipse_and_lane_changes": ("path_of_curvature",),
    "plant_emulator.settings": ("PlantSettings",),
    "plant_emulator.vehicle.car.car_choice": ("CarModel",),
    "plant_emulator.vehicle.car.car_step": ("CarInput", "CarParams", "CarState", "car_step"),
    "plant_emulator.vehicle.settings": ("VehicleInput", "VehicleModel", "VehicleState"),
    "plant_emulator.vehicle.single_track_model": ("VehicleParams",),
    "plant_emulator.path.waypoints": ("path_through",),
    "runtime.settings": ("Settings", "SettingsError"),
    "closed_loop.reports.plot_style": ("law_styles",),
    "closed_loop.scripting.simulated_run": ("ControllerTable", "PlantTable", "Run", "Track"),
    "closed_loop.scripting.simulate": ("controller_presets", "plant_presets", "simulate"),
    "closed_loop.studies.run_study": ("run_study", "sweep"),
    "closed_loop.scripting.check": ("Check", "check"),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
"""Where each name comes from. It is imported at its first use: importing the package itself takes
the standard library alone."""

__all__ = [
    "CarInput",
    "CarModel",
    "CarParams",
    "CarState",
    "Check",
    "ControllerSettings",
    "ControllerTable",
    "FeedbackStability",
    "Law",
    "LawInput",
    "LawOutput",
    "Mode",
    "PathModel",
    "PlantSettings",
    "PlantTable",
    "Run",
    "Settings",
    "SettingsError",
    "Track",
    "VehicleInput",
    "VehicleModel",
    "VehicleParams",
    "VehicleState",
    "car_step",
    "check",
    "controller_presets",
    "feedback_stability",
    "law_styles",
    "path_of_curvature",
    "path_through",
    "plant_presets",
    "run_study",
    "simulate",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
