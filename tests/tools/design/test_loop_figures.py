"""Responses of plants and figures of loops, for many at once: impulse responses and signals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.controller.analysis.linear_system import held_plant
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.filters.nominal_model import steer_to_lateral_error
from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.laws import PAPER_LAWS
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.tools.design.loop_figures import (
    behind_lag,
    circle_grid,
    loop_figures,
    plant_responses,
)
from steer_by_wire.tools.paper.corners import corner_vehicles

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
CORNERS = corner_vehicles()
MODELS = [steer_to_lateral_error(corner) for corner in CORNERS]


def preset(law: str) -> ControllerSettings:
    """The law that holds the preview point on the path: its error is that on the bus."""
    heading = ("pid.heading_gain_rad_rad=0.2",) if law == "pid_heading" else ()
    name = f"practical_{law.removesuffix('_heading')}"
    return controller_preset(name, ("followed_point=preview", *heading))


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 30 * PERIOD_NS), st.sampled_from([0.0, 0.1]))
def test_a_plant_s_response_is_its_impulse_response_summed(delay_ns: int, lag_s: float) -> None:
    model = behind_lag(MODELS[2], lag_s)
    z = 1.5 * np.exp(1j * np.linspace(0.0, math.pi, 7))
    plant = held_plant(model, PERIOD_NS, delay_ns)
    state, total = np.zeros(len(plant.a)), np.zeros(len(z), dtype=np.complex128)
    for tick in range(200):
        total += float(plant.c[0] @ state) * z ** float(-tick)
        new, old = tick == plant.whole_periods, tick == plant.whole_periods + 1
        state = plant.a @ state + plant.b_new * new + plant.b_old * old
    ((response,),) = plant_responses([model], [delay_ns], PERIOD_NS, z)[0]
    assert np.abs(response - total).max() < 1e-9 * np.abs(total).max()


@pytest.mark.parametrize("law", [*PAPER_LAWS, "pid_heading", "smith"])
@pytest.mark.parametrize("delay_ns", [0, 203 * MS_NS])
def test_the_figures_of_a_loop_are_those_of_its_signals(law: str, delay_ns: int) -> None:
    design, rates = design_law(preset(law)), LoopDelayParams(PERIOD_NS, PERIOD_NS, 50.0)
    signals = PeriodicLoop(design, rates, LoopModel(CORNERS[2]))
    found = loop_figures(circle_grid([MODELS[2]], [delay_ns], PERIOD_NS, 800), design)
    assert found.peak_sensitivity == pytest.approx(signals.peak_sensitivity(delay_ns), rel=5e-3)
    assert found.noise_gain_rad_m == pytest.approx(signals.noise_gain_rad_m(delay_ns), rel=2e-3)
