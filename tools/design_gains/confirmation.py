"""Stability of what the search has found, by all eigenvalues of the sampled loop.

The search counts encirclements on a grid; this has no grid. Besides, the delays at which each
corner's loop is stable beyond what is demanded, and to which the RMS stays below its limit.
"""

from typing import NamedTuple

from ...controller.analysis.sampled_loop import SampledLoop
from ...loop_theory.responses import behind_lag
from ...runtime.node import NS_PER_MS
from .candidate import Candidate, controller_settings, designs
from .study import Study

DELAY_NS_MAX = 2_000 * NS_PER_MS
_STABLE_1_S = 1e-3


class Confirmation(NamedTuple):
    """Stability of a law by eigenvalues.

    ``decay_1_s``         of the slowest mode over all corners and delays of the range [1/s]
    ``failures``          how many loops do not do what is demanded of them
    ``stable_up_to_ns``   the largest of 0, step, 2 step, ... up to which every corner is stable
    ``with_lag_up_to_ns``  the same behind the lag of the steering; None where none is specified
    """

    decay_1_s: float
    failures: int
    stable_up_to_ns: int
    with_lag_up_to_ns: int | None

    @property
    def stable(self) -> bool:
        """Whether all is as demanded."""
        return self.failures == 0


def confirm(study: Study, candidate: Candidate) -> Confirmation:
    """Return the results from the eigenvalues of every loop of the specification."""
    spec = study.spec
    design, _ = designs(controller_settings(spec, study.vehicle, candidate.law, candidate.values()))
    settling_1_s = spec.d_stability.settling_1_s
    step_ns = round(spec.delay.step_ms * NS_PER_MS)
    loops = [SampledLoop(design, model, spec.period_ns) for model in study.models]
    decays = [loop.decay_1_s(delay_ns) for loop in loops for delay_ns in spec.delays_ns]
    demanded = settling_1_s if "settling" in study.stability else _STABLE_1_S
    failures = sum(decay <= demanded for decay in decays)
    if "delay margin" in study.stability:
        beyond_ns = tuple(d for d in spec.margin_delays_ns if d > spec.delays_ns[-1])
        failures += _failures(loops, beyond_ns)
    with_lag_ns = None
    if spec.actuator is not None:
        lag_s = spec.actuator.lag_s
        lagged = [
            SampledLoop(design, behind_lag(model, lag_s), spec.period_ns) for model in study.models
        ]
        if "actuator lag" in study.stability:
            failures += _failures(lagged, spec.lag_delays_ns)
        with_lag_ns = stable_up_to_ns(lagged, step_ns)
    return Confirmation(min(decays), failures, stable_up_to_ns(loops, step_ns), with_lag_ns)


def stable_up_to_ns(loops: list[SampledLoop], step_ns: int) -> int:
    """Return the last delay of 0, step, 2 step, ... before the first that any loop fails at [ns].

    -1 if one is unstable without delay.
    """
    for delay_ns in range(0, DELAY_NS_MAX + 1, step_ns):
        if not all(loop.is_stable(delay_ns) for loop in loops):
            return max(-1, delay_ns - step_ns)
    return DELAY_NS_MAX


def _failures(loops: list[SampledLoop], delays_ns: tuple[int, ...]) -> int:
    return sum(not loop.is_stable(delay_ns) for loop in loops for delay_ns in delays_ns)
