"""Loops and constants of the tests of the gain plane."""

import pytest

from steer_by_wire.closed_loop.parameter_space.d_stability import paper_d_stability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import Window
from steer_by_wire.closed_loop.parameter_space.gain_loops import ContinuousGainLoop, SampledGainLoop
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction
from steer_by_wire.runtime.node import NS_PER_MS

PERIOD_NS = 10 * NS_PER_MS
SPEC = paper_d_stability()
WINDOW = Window(-0.5, 3.5, -0.6, 2.4)
PUBLISHED = (1.0596, 0.939)
INTEGRATOR = TransferFunction(-1, (Factor(0.0, 0.0, 1.0),), ())
DOUBLE_INTEGRATOR = TransferFunction(-2, (Factor(0.0, 0.0, 1.0),), ())
LEAD = TransferFunction(0, (Factor(0.0, 1.0, 2.0),), (Factor(1.0, 1.0, 1.0),))  # (s+2)/(s²+s+1)
CORNERS = tuple(steer_to_lateral_error(vehicle) for vehicle in paper_box().vertices())

Loop = ContinuousGainLoop | SampledGainLoop
LOOPS: dict[str, Loop] = {
    "continuous": ContinuousGainLoop(paper_eq19()),
    "continuous, corner": ContinuousGainLoop(CORNERS[3]),
    "sampled integrator": SampledGainLoop(INTEGRATOR, PERIOD_NS, 0),
    "sampled": SampledGainLoop(paper_eq19(), PERIOD_NS, 0),
    "sampled, filtered, 80 ms": SampledGainLoop(CORNERS[0], PERIOD_NS, 80 * NS_PER_MS, 20.0),
    "sampled, filtered, 163 ms": SampledGainLoop(paper_eq19(), PERIOD_NS, 163 * NS_PER_MS, 5.0),
}
EVERY_LOOP = pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS.keys())
