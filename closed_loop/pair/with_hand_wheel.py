"""A hand wheel for a pair: what plant and controller need for it, and what it takes from the plant.

What a settings file says stays; only tables that are omitted, or say the default, are filled.
"""

from typing import NamedTuple

from ...controller.settings import ControllerSettings
from ...controller.who_steers import HandWheelSettings as WhoSteersSettings
from ...hand_wheel.settings import HandWheelSettings, NominalModelSettings
from ...plant_emulator.sensors.settings import SteeringForceSettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.hand_wheel import HandWheelSettings as LinkSettings
from ...runtime.settings import SettingsError


class WithHandWheel(NamedTuple):
    """Settings of three nodes that fit each other."""

    plant: PlantSettings
    controller: ControllerSettings
    hand_wheel: HandWheelSettings


def with_hand_wheel(
    plant: PlantSettings, controller: ControllerSettings, wheel: HandWheelSettings
) -> WithHandWheel:
    """Return the settings of a pair with a hand wheel.

    The plant sends STEERING_FORCE once a cycle of the wheel and takes its angle over its ratio; the
    nominal model is the plant's vehicle. Raises SettingsError for steering ratios that differ.
    """
    ratio = wheel.steering_ratio
    force = plant.steering_force or SteeringForceSettings(period_ms=wheel.cycle_ms)
    link = plant.hand_wheel or LinkSettings(steering_ratio=ratio)
    driver = controller.hand_wheel or WhoSteersSettings(steering_ratio=ratio)
    ratios = {
        "hand_wheel": ratio,
        "plant.hand_wheel": link.steering_ratio,
        "controller.hand_wheel": driver.steering_ratio,
    }
    if len(set(ratios.values())) > 1:
        told = ", ".join(f"{table} has {its:g}" for table, its in ratios.items())
        raise SettingsError(f"steering_ratio differs: {told}; give all three the same")
    if wheel.nominal_model == NominalModelSettings():
        wheel = wheel.model_copy(update={"nominal_model": nominal_model_of(plant, force)})
    return WithHandWheel(
        plant.model_copy(update={"steering_force": force, "hand_wheel": link}),
        controller.model_copy(update={"hand_wheel": driver}),
        wheel,
    )


def nominal_model_of(plant: PlantSettings, force: SteeringForceSettings) -> NominalModelSettings:
    """Return a plant's vehicle and steering, as the feedback takes them."""
    vehicle, trail_m, arm_m = plant.vehicle, force.trail_m, force.arm_m
    if plant.car is not None and plant.car.rack is not None:
        rack = plant.car.rack
        trail_m, arm_m = rack.caster_trail_m + rack.pneumatic_trail_m, rack.arm_m
    own = {name: getattr(vehicle, name) for name in NominalModelSettings.of_vehicle}
    lag_s = plant.actuator.lag_s
    return NominalModelSettings(**own, actuator_lag_s=lag_s, trail_m=trail_m, arm_m=arm_m)
