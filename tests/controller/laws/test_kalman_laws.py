"""The paper's laws with dy/dt from the Kalman filter."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from steer_by_wire.controller.laws import LAWS
from steer_by_wire.controller.laws.kalman_derivative import KalmanParams, error_rate_m_s
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.prediction.gains_over_speed import SPEED_M_S_MAX
from steer_by_wire.controller.prediction.vehicle_kalman_filter import EstimatorState
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.settings import SettingsError
from tests.support.loops.deaf_controller import is_echo, run_deaf
from tests.support.runs.compiled_runs import assert_same_as_nodes

KALMAN = "pd.derivative=kalman"


def controller(*overrides: str, preset: str = "practical_pd_ddob") -> ControllerSettings:
    return controller_preset(preset, overrides)


def plant(*overrides: str) -> PlantSettings:
    path = 'path={kind="ellipse", semi_major_axis_m=30, semi_minor_axis_m=15}'
    settings = ("duration_s=8", path, "latency.downlink.mean_s=0.1", *overrides)
    return plant_preset("paper_nominal", settings)


def steers(
    plant_settings: PlantSettings,
    settings: ControllerSettings,
    is_dropped: Callable[[Frame, int], bool] = lambda _frame, _now_ns: False,
) -> np.ndarray:
    """Return the commands of a run; ``is_dropped`` selects frames lost before the controller."""
    _, node = run_deaf(plant_settings, settings, is_dropped)
    return np.array([sample.sent_steer_rad for sample in node.samples])


@pytest.mark.parametrize("law", [name for name, law in LAWS.items() if law.takes_derivative])
def test_without_echoes_the_derivative_is_the_filtered_difference_to_the_last_bit(law: str) -> None:
    settings = controller(f"law={law}", KALMAN)
    filtered = controller(f"law={law}")
    np.testing.assert_array_equal(
        steers(plant(), settings, is_echo), steers(plant(), filtered, is_echo)
    )


def test_the_derivative_is_that_of_the_lateral_error() -> None:
    """y' = V β + l_s r + V Δψ, (1), by hand."""
    design = design_law(controller("law=pd", KALMAN))
    assert design.params_at is not None
    params = design.params_at(2.0)
    assert isinstance(params, KalmanParams)
    x = EstimatorState(0, 0.01, 0.1, 0.05, 9.0, 9.0, 9.0, 9.0)
    expected = 2.0 * 0.01 + 2.0 * 0.1 + 2.0 * 0.05
    assert error_rate_m_s(params.derivative, x) == pytest.approx(expected)


def test_beyond_the_table_of_speeds_the_speed_is_that_of_its_gains() -> None:
    design = design_law(controller("law=pd", KALMAN, "estimator.speed_m_s_max=10.0"))
    assert design.params_at is not None
    assert design.params_at(30.0) != design.params_at(10.0)  # only the feedback's weight ends there
    assert design.params_at(2.0 * SPEED_M_S_MAX) == design.params_at(1.5 * SPEED_M_S_MAX)
    assert design.params_at(0.0).derivative.speed_m_s == 0.5


def test_noise_moves_the_steer_less_than_with_the_filtered_difference() -> None:
    noisy = "sensor_noise.lateral_error_m=0.002"
    moved = {
        derivative: float(
            np.diff(steers(plant(noisy), controller(f"pd.derivative={derivative}"))[200:]).std()
        )
        for derivative in ("filtered", "kalman")
    }
    assert 0.3 * moved["filtered"] < moved["kalman"] < 0.5 * moved["filtered"]


@pytest.mark.parametrize("back_s", [3.1, 5.5, 6.5])
def test_echoes_that_stop_and_come_back_are_no_jump(back_s: float) -> None:
    """After 0.1 s nothing has changed, after 2.5 s the filter goes on, after 3.5 s it is anew."""
    settings = controller(KALMAN)
    gap = steers(
        plant(), settings, lambda frame, now_ns: is_echo(frame) and 3e9 < now_ns < 1e9 * back_s
    )
    whole = steers(plant(), settings)
    fade_step_rad = 0.002
    largest = np.abs(np.diff(whole))[100:].max()
    assert np.abs(np.diff(gap))[100:].max() < largest + fade_step_rad
    assert np.abs(np.diff(gap))[300:].max() < fade_step_rad


def test_a_compiled_run_gives_the_bits_of_the_nodes() -> None:
    network = (
        *("latency.downlink.model=gamma", "latency.downlink.spread_s=0.03"),
        *("latency.uplink.mean_s=0.03", "latency.uplink.loss=0.05"),
    )
    assert_same_as_nodes(plant(*network), controller(KALMAN))


@pytest.mark.parametrize(
    ("overrides", "preset", "message"),
    [
        (
            ("law=predictor", "predictor.horizon_s_max=1.0"),
            "practical_pd_ddob",
            "pd.derivative = 'kalman' is not for law = 'predictor'",
        ),
        ((), "paper_pd_ddob", "needs nominal_model.kind = 'vehicle'"),
        (("pd.derivative=exact",), "practical_pd", "pd.derivative"),
    ],
)
def test_what_has_no_derivative_by_the_filter_is_refused(
    overrides: Sequence[str], preset: str, message: str
) -> None:
    with pytest.raises(SettingsError, match="derivative") as refused:
        controller(KALMAN, *overrides, preset=preset)
    assert message in str(refused.value)


@pytest.mark.parametrize("law", ["law=predictor", "pd.derivative=kalman"])
def test_settings_without_gains_are_reported_in_a_line_that_names_table_and_speed(law: str) -> None:
    settings = controller(
        law, "predictor={}", "estimator.curvature_walk_1_m_sqrt_s=1e-12", preset="practical_pd_ddob"
    )
    with pytest.raises(SettingsError, match=r"^\[estimator\] has no gains at .* m/s: .*\Z"):
        design_law(settings)
