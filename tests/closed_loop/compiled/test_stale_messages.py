"""Laws without a VEHICLE_STATE or STEERING_STATUS, live and compiled."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.closed_loop.compiled.law_input import Uplink
from steer_by_wire.closed_loop.compiled.loop_records import ARRIVED_NS, MESSAGE, Inbox
from steer_by_wire.closed_loop.compiled.schedule import RunSchedule, inbox_of, schedule_run
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.law_interface import LawInput, VehicleReading
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.limits.fades_and_ramps import FADE_RAD_S
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.run_figures import ControlSample
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.controller.settings import controller_preset as preset
from steer_by_wire.dbc.messages import CAN_IDS, Mode, VehicleState
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.runtime.frame import Frame
from tests.support.runs.compiled_runs import assert_same_as_nodes
from tests.support.runs.compiled_runs import plant_settings as plant

CIRCLE = ('path={kind="circle", radius_m=30.0}',)
LAWS: dict[str, tuple[str, Sequence[str]]] = {
    "predictor": ("practical_predictor", ("followed_point=preview",)),
    "feed_forward": ("practical_pd_ddob", ("feed_forward={}", "followed_point=preview")),
}
BURSTS = ("latency.uplink.loss=0.4", "latency.uplink.burst_frames=30", "latency.uplink.mean_s=0.03")
SHORT_LIMITS = (
    "supervision.steering_status_timeout_ms=30",
    "supervision.vehicle_state_timeout_ms=50",
)
STEP_RAD = FADE_RAD_S * 0.01


def settings_of(law: str, overrides: Sequence[str] = ()) -> ControllerSettings:
    name, tables = LAWS[law]
    return preset(name, (*tables, *overrides))


def age_ns(wire: Inbox, message: Uplink, plan: RunSchedule) -> NDArray[np.int64]:
    """The age of a message at each tick, -1 before the first."""
    arrival_ns = wire.arrivals[ARRIVED_NS, wire.arrivals[MESSAGE] == message]
    newest = np.searchsorted(arrival_ns, plan.instants.ticks[0], side="right") - 1
    return np.where(newest >= 0, plan.instants.ticks[0] - arrival_ns[newest], -1)


@pytest.mark.parametrize("limits", [(), SHORT_LIMITS], ids=["default limits", "short limits"])
@pytest.mark.parametrize("law", LAWS)
def test_a_compiled_run_equals_the_nodes_where_messages_go_stale(
    law: str, limits: Sequence[str]
) -> None:
    plant_settings, controller = plant((*BURSTS, *CIRCLE), 8.0), settings_of(law, limits)
    run = assert_same_as_nodes(plant_settings, controller)
    plan = schedule_run(plant_settings, controller)
    wire = inbox_of(plant_settings, controller, plan)
    is_active = np.zeros(len(plan.instants.ticks[0]), dtype=np.bool_)
    for segment in plan.segments:
        if segment.mode == Mode.ACTIVE:
            is_active[segment.first_tick : segment.last_tick] = True
    limits_ns = controller.age_limits
    is_stale = age_ns(wire, Uplink.VEHICLE_STATE, plan) > limits_ns.vehicle_state_ns
    is_late = age_ns(wire, Uplink.STEERING_STATUS, plan) > limits_ns.steering_status_ns
    # The run is meaningful: while the law steers, either message goes stale, and with short limits
    # STEERING_STATUS does so alone.
    assert (is_active & is_stale).any()
    assert (is_active & (is_stale | is_late)).any()
    if limits:
        assert (is_active & ~is_stale & is_late).any()
    assert len(run.tick_s) > 700


# Without VEHICLE_STATE


@cache
def driven(law: str, *overrides: str) -> tuple[tuple[ControlSample, ...], PlantNode]:
    """A run on a circle, without VEHICLE_STATE from 6 s to 10 s."""

    class Deaf(ControllerNode):
        def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
            if frame.can_id == CAN_IDS[VehicleState] and 6e9 < now_ns < 10e9:
                return ()
            return super().on_frame(frame, now_ns)

    node = Deaf(settings_of(law, overrides), 0, samples_max=10_000)
    plant_node = PlantNode(plant(("latency.downlink.mean_s=0.05", *CIRCLE), 16.0), 0)
    run_virtual_nodes(plant_node, node, None, None, lambda: False)
    return tuple(node.samples), plant_node


@pytest.mark.parametrize("law", LAWS)
def test_neither_losing_the_vehicle_nor_having_it_back_is_a_jump(law: str) -> None:
    samples, _ = driven(law)
    time_s = np.array([sample.time_ns for sample in samples]) * 1e-9
    steps = np.abs(np.diff([sample.sent_steer_rad for sample in samples]))
    usual_rad = steps[(time_s[1:] > 5.0) & (time_s[1:] < 6.0)].max()
    assert steps[time_s[1:] > 5.0].max() < usual_rad + STEP_RAD + 2e-3
    assert {sample.mode for sample in samples[100:]} == {Mode.ACTIVE}


def test_the_feed_forward_of_an_old_curve_fades_out_and_comes_back() -> None:
    """With pd, which without it stays beside the circle."""
    law = design_law(preset("practical_pd", ("feed_forward={}", "followed_point=preview")))
    plain = design_law(preset("practical_pd", ("followed_point=preview",)))
    curve = VehicleReading(1.4, 0.0, 0.05)
    old = curve._replace(is_stale=True)
    state: Any = law.initial_state(0.0)
    shares = []
    for vehicle in [curve] * 5 + [old] * 200 + [curve] * 200:
        state, output = law.step(law.params, state, LawInput(0.0, 0.0, vehicle))
        shares.append(output.steer_rad)
    _, without = plain.step(plain.params, plain.initial_state(0.0), LawInput(0.0, 0.0))
    whole_rad = shares[0]
    assert whole_rad == pytest.approx(0.05 * 2.85, rel=0.02)
    assert shares[:6] == [whole_rad] * 6  # the first without it is still the last with it
    assert np.abs(np.diff(shares)).max() == pytest.approx(STEP_RAD)
    assert shares[204] == without.steer_rad == 0.0
    assert shares[205] == 0.0
    assert shares[-1] == whole_rad


def test_a_vehicle_that_is_stale_when_the_law_starts_adds_nothing_and_comes_in_gently() -> None:
    law = design_law(preset("practical_pd", ("feed_forward={}", "followed_point=preview")))
    curve = VehicleReading(1.4, 0.0, 0.05)
    state: Any = law.initial_state(0.0)
    shares = []
    for vehicle in [curve._replace(is_stale=True)] * 3 + [curve] * 100:
        state, output = law.step(law.params, state, LawInput(0.0, 0.0, vehicle))
        shares.append(output.steer_rad)
    assert shares[:4] == [0.0] * 4
    assert np.diff(shares)[3:10] == pytest.approx(STEP_RAD)


def test_the_predictor_falls_back_while_the_vehicle_is_stale_and_goes_on_at_once_after() -> None:
    """Its filter runs on at the last speed, and has nothing to settle from."""
    samples, _ = driven("predictor")
    time_s = np.array([sample.time_ns for sample in samples]) * 1e-9
    predicts = np.array([s.law_output.network_disturbance_rad == 0.0 for s in samples])
    assert predicts[(time_s > 3.0) & (time_s < 6.1)].all()
    assert not predicts[(time_s > 6.2) & (time_s < 9.95)].any()
    assert predicts[time_s > 10.1].all()


def test_a_vehicle_that_is_never_stale_is_steered_by_however_old() -> None:
    samples, plant_node = driven("feed_forward", 'supervision.vehicle_state_timeout_ms="off"')
    watched, limited = driven("feed_forward")
    assert [s.sent_steer_rad for s in samples] != [s.sent_steer_rad for s in watched]
    # On a circle the old curve is the right one: the limit costs something there, but not the path.
    errors_m = [
        np.abs([s.lateral_error_m for s in node.samples]).max() for node in (plant_node, limited)
    ]
    assert errors_m[0] < errors_m[1] < 0.2
