"""Settings of the feed-forward, and runs of the nodes with them."""

from collections.abc import Sequence

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.run_figures import ControlSample
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.support.runs.compiled_runs import plant_settings as rig

FEED_FORWARD = ("feed_forward={}",)
CIRCLE = ('path={kind="circle", radius_m=30.0}',)


def run_nodes(plant: PlantSettings, settings: ControllerSettings) -> ControllerNode:
    """The controller's node after a run in virtual time, its ticks kept."""
    node = ControllerNode(settings, 0, samples_max=1_000_000)
    run_virtual_nodes(PlantNode(plant, 0), node, None, None, lambda: False)
    return node


def vehicle_of(settings: ControllerSettings) -> VehicleModelSettings:
    assert isinstance(settings.nominal_model, VehicleModelSettings)
    return settings.nominal_model


def on_a_circle(name: str, overrides: Sequence[str], *more: str) -> ControlSample:
    """The last tick after half a minute of the nodes, the nominal vehicle on a circle of 30 m."""
    plant = rig(
        [*CIRCLE, "vehicle.speed_m_s=1.3888888888888888", "vehicle.virtual_mass_kg=2000", *more],
        30.0,
    )
    return run_nodes(plant, preset(name, overrides)).samples[-1]
