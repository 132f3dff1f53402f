"""The bound on a counter's step costs a network with jitter no measurement."""

import pytest

from steer_by_wire.closed_loop.compiled.law_input import Uplink
from steer_by_wire.closed_loop.compiled.schedule import arrivals_of
from steer_by_wire.closed_loop.compiled.step_functions import register_steps
from steer_by_wire.controller.settings import controller_preset
from tests.support.runs.compiled_runs import plant_settings

SAMPLES = 6000
UNBOUND_NS = 10**10


@pytest.mark.parametrize(
    ("model", "mean_s", "spread_s"),
    [
        ("normal", 0.08, 0.03),
        ("normal", 0.4, 0.4),
        ("lognormal", 0.4, 0.4),
        ("gamma", 0.4, 0.4),
        ("uniform", 0.4, 0.4),
    ],
)
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_where_the_newest_wins_all_that_arrives_is_accepted(
    model: str, mean_s: float, spread_s: float, loss: float
) -> None:
    register_steps()
    line = {"model": model, "mean_s": mean_s, "spread_s": spread_s, "loss": loss}
    plant = plant_settings([f"latency.uplink.{key}={value}" for key, value in line.items()])
    rule = controller_preset("practical_pd_ddob").counters
    accepted = [
        arrivals_of(message, plant, one, SAMPLES, 0).arrival_ns.tolist()
        for message in Uplink
        for one in (rule, rule._replace(lead_ns=UNBOUND_NS))
    ]
    assert accepted[0::2] == accepted[1::2]
    assert len(accepted[0]) > SAMPLES // 10
