"""The summary of a run: what did not happen has no line, what is not known no figure."""

from steer_by_wire.plant_emulator.evaluation.report_in_words import plant_summary
from tests.support.nodes.plant_link import START_NS, link, steered


def test_without_motion_there_is_no_error_to_report() -> None:
    tested = link()
    tested.tick_until(START_NS)
    lines = dict(plant_summary(tested.node.report()))
    assert lines["car"] == "unknown: the vehicle has not moved"
    assert lines["commands"] == "latency unknown, 0 lost"
    assert "limited" not in lines
    assert "plant rejected" not in lines


def test_with_motion_there_are_error_latency_and_who_limits() -> None:
    tested = steered(20, safety={"angle_rad_max": 0.05}, latency={"downlink": {"mean_s": 0.02}})
    fault = {"kind": "drop", "message": "STEERING_COMMAND", "direction": "downlink", "changed": 3}
    lines = dict(plant_summary({**tested.node.report(), "faults": [fault]}))
    assert lines["fault"] == "drop of STEERING_COMMAND, downlink, frames: 3"
    assert lines["preview point"].startswith("off the path RMS ")
    assert lines["commands"].startswith("latency p50 20.00 ms")
    assert lines["limited"].startswith("commands by angle ")
