"""What compiled runs are timed against is the same run: in C to the last bit."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_batch
from steer_by_wire.closed_loop.compiled.schedule import plan_run
from steer_by_wire.tools.benchmark_batch.c_pair import CPair, MissingCompilerError, compile_pair
from steer_by_wire.tools.benchmark_batch.comparison import DELAY_S, NETWORKS, pair_settings
from steer_by_wire.tools.benchmark_batch.other_tools import JitcddeLoop


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("network", NETWORKS)
def test_the_c_program_gives_the_same_bits(network: str, tmp_path: Path) -> None:
    plant, controller = pair_settings(NETWORKS[network], duration_s=5.0)
    plan = plan_run(plant, controller)
    here = run_batch(plant, controller, plan)
    there = CPair(compile_pair(tmp_path), plant, controller, plan).run()
    first = len(there.lateral_error_m) - len(here.lateral_error_m)
    assert np.ptp(here.lateral_error_m) > 0.001
    np.testing.assert_array_equal(here.lateral_error_m, there.lateral_error_m[first:])
    np.testing.assert_array_equal(here.wheel_angle_rad, there.wheel_angle_rad[first:])
    np.testing.assert_array_equal(here.sent_rad, there.sent_rad)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize(
    "network",
    [
        ("mean_s=0.05", "loss=0.3", "burst_frames=40"),
        ("mean_s=0.05", "loss=0.6", "burst_frames=120"),
        ("loss=0.85",),  # single commands, and gaps of just 140 ms
    ],
)
def test_the_c_program_guards_the_steering_to_the_same_bits(
    network: tuple[str, ...], tmp_path: Path
) -> None:
    plant, controller = pair_settings(network, duration_s=20.0)
    safety = plant.safety.model_copy(
        update={"lateral_jerk_m_s3_max": 0.2, "ramp_rad_s": 0.02, "override_at_s": 18.0}
    )
    plant = plant.model_copy(update={"safety": safety})
    plan = plan_run(plant, controller)
    here = run_batch(plant, controller, plan)
    there = CPair(compile_pair(tmp_path), plant, controller, plan).run()
    first = len(there.lateral_error_m) - len(here.lateral_error_m)
    acted = here.wheel_angle_rad != here.command_rad
    assert np.count_nonzero(acted & (here.time_s < 18.0)) > 50
    np.testing.assert_array_equal(here.lateral_error_m, there.lateral_error_m[first:])
    np.testing.assert_array_equal(here.wheel_angle_rad, there.wheel_angle_rad[first:])


def test_without_a_compiler_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingCompilerError, match="install one"):
        compile_pair(tmp_path)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_jitcdde_integrates_the_loop_that_a_fast_sampled_run_comes_close_to() -> None:
    pytest.importorskip("jitcdde", reason="jitcdde is not installed")
    plant, controller = pair_settings(NETWORKS["80 ms"], duration_s=20.0)
    plant = plant.model_copy(update={"sensor_period_ms": 1.0})
    controller = controller.model_copy(update={"rate_hz": 1000.0})
    run = run_batch(plant, controller)
    error_m = JitcddeLoop(plant, controller, DELAY_S).run(run.time_s[9::10])
    assert np.ptp(error_m) > 0.01
    np.testing.assert_allclose(error_m, run.lateral_error_m[9::10], atol=0.005 * np.ptp(error_m))
