"""The pytest plugin, run on tests that somebody might write."""

from pathlib import Path

import pytest

# pytester forgets what a run imports, and numpy refuses to be imported twice.
import steer_by_wire.closed_loop.rig  # noqa: F401

pytest_plugins = ["pytester"]

HEADER = "import pytest\n"


def test_a_rig_runs_once_with_each_seed(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        HEADER
        + """
@pytest.mark.steer_by_wire(latency_s=0.08, seeds=[3, 4], overrides={"duration_s": 2.0})
def test_it_holds(rig):
    assert rig.settings.latency.downlink.mean_s == 0.08
    rig.run("practical_pd_ddob").assert_holds(rms_m=0.1)
"""
    )
    result = pytester.runpytest_inprocess("--junitxml=junit.xml", "-v", "-p", "no:xdist")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*test_it_holds[[]seed3[]]*", "*test_it_holds[[]seed4[]]*"])
    assert '<property name="seed" value="3"' in (pytester.path / "junit.xml").read_text()


def test_a_failed_run_names_log_picture_and_seed(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        HEADER
        + """
@pytest.mark.steer_by_wire(seeds=[9], overrides={"duration_s": 2.0})
def test_it_is_perfect(rig):
    rig.run("practical_pd").assert_holds(rms_m=0.0)
"""
    )
    result = pytester.runpytest_inprocess("-p", "no:xdist")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*RMS deviation of the car * m is above 0 m", "seed     9", "log *"]
    )
    result.stdout.no_fnmatch_line("*outcome_and_assertions.py*")
    (picture,) = [line for line in result.outlines if line.startswith("picture ")]
    assert Path(picture.split()[1]).is_file()


def test_the_bus_of_a_test_carries_and_records_frames(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
import can

def test_a_frame_arrives(can_bus, recording):
    with can_bus.open() as sender, can_bus.open() as receiver:
        sender.send(can.Message(arbitration_id=0x123, data=b"ab", is_extended_id=False))
        message = receiver.recv(300.0)
    assert message.arbitration_id == 0x123
    assert recording.is_file()
"""
    )
    pytester.runpytest_inprocess("-p", "no:xdist").assert_outcomes(passed=1)


@pytest.mark.parametrize(
    ("marker", "said"),
    [
        ("latency=0.1", "takes plant, latency_s, seeds"),
        ("0.1", "positional arguments"),
        ("seeds=[]", "seeds = [] should be a list, as [1, 2]"),
        ('bus="vcan0"', "known: auto, socketcan, emulated"),
    ],
)
def test_a_wrong_marker_is_explained(pytester: pytest.Pytester, marker: str, said: str) -> None:
    pytester.makepyfile(
        HEADER + f"\n@pytest.mark.steer_by_wire({marker})\ndef test_it(rig):\n    pass\n"
    )
    result = pytester.runpytest_inprocess("-p", "no:xdist")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines([f"*{said}*"])
    result.stdout.no_fnmatch_line("*pytest_plugin.py*")
