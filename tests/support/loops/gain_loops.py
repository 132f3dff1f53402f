"""Loops and constants of the tests of the gain plane."""

import pytest

from steer_by_wire.closed_loop.parameter_space.d_stability import paper_d_stability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import Window
from steer_by_wire.closed_loop.parameter_space.gain_loop import GainLoop
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction

SPEC = paper_d_stability()
WINDOW = Window(-0.5, 3.5, -0.6, 2.4)
DOUBLE_INTEGRATOR = TransferFunction(-2, (Factor(0.0, 0.0, 1.0),), ())
LEAD = TransferFunction(0, (Factor(0.0, 1.0, 2.0),), (Factor(1.0, 1.0, 1.0),))  # (s+2)/(s²+s+1)
CORNERS = tuple(steer_to_lateral_error(vehicle) for vehicle in paper_box().vertices())

LOOPS: dict[str, GainLoop] = {
    "nominal": GainLoop(paper_eq19()),
    "corner": GainLoop(CORNERS[3]),
}
EVERY_LOOP = pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS.keys())
