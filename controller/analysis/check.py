"""What ``steering-controller --check`` prints: the settings in effect, and what the loop tolerates.

The text as a whole is a settings file again: all but the settings are TOML comments.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from controller.analysis.linear_system import law_system
from controller.analysis.sampled_loop import SLOWEST_DECAY_1_S, SampledLoop
from controller.design import design_law
from controller.settings import ControllerSettings
from runtime.node import NS_PER_MS, NS_PER_S
from runtime.settings import dump_toml

DELAY_STEP_NS = 10_000_000
DELAY_NS_MAX = 600_000_000
_MODULUS_SHOWN_MIN = 1e-3
"""Poles closer to z = 0 belong to memory that is empty after a few periods."""


def check_text(settings: ControllerSettings) -> str:
    """Return the settings and the analysis of their loop around the nominal plant."""
    comments = [_rate(settings), "", *_analysis(settings)]
    lines = [f"# {comment}" if comment else "#" for comment in comments]
    return "\n".join([dump_toml(settings), *lines, ""])


def _rate(settings: ControllerSettings) -> str:
    rate_hz = NS_PER_S / settings.period_ns
    return f"Runs at {rate_hz:.9g} Hz, every {settings.period_ns} ns."


def _analysis(settings: ControllerSettings) -> Iterator[str]:
    design, period_ns = design_law(settings), settings.period_ns
    yield "Poles of the law alone:"
    law_poles = np.linalg.eigvals(law_system(design).a).astype(np.complex128)
    yield from _poles(law_poles, period_ns)
    yield ""
    if settings.model is None:
        yield "There is no [nominal_model], hence no closed loop to analyse."
        return
    loop = SampledLoop(design, settings.model, period_ns)
    yield "Poles of the closed loop around the nominal plant, without delay:"
    yield from _poles(loop.closed_loop_poles(0), period_ns)
    yield ""
    decay_1_s = loop.decay_1_s(0)
    if decay_1_s <= SLOWEST_DECAY_1_S:
        yield "NOT STABLE, even without delay:"
        yield f"  its slowest mode {_decay_in_words(decay_1_s)}"
    else:
        yield "Margins without delay, at the command on the wire:"
        yield from _margins(loop)
    yield ""
    yield "Constant delay between command and wheel angle:"
    yield from _delays(loop)


def _poles(poles: NDArray[np.complex128], period_ns: int) -> Iterator[str]:
    """Return a table of poles, slowest first, a conjugate pair in one line."""
    shown = [pole for pole in poles if abs(pole) >= _MODULUS_SHOWN_MIN]
    if shown:
        yield f"  {'z':>24} {'|z|':>12} {'decay [1/s]':>14} {'omega [rad/s]':>18}"
    for pole in sorted(shown, key=lambda pole: (-abs(pole), -pole.real)):
        if pole.imag < 0.0:
            continue
        z = f"{pole.real:.6f} ± {pole.imag:.6f}j" if pole.imag else f"{pole.real:.6f}"
        decay_1_s = round(-math.log(abs(pole)) * NS_PER_S / period_ns, 4) + 0.0  # no "-0.0000"
        omega_rad_s = abs(np.angle(pole)) * NS_PER_S / period_ns
        yield f"  {z:>24} {abs(pole):>12.6f} {decay_1_s:>14.4f} {omega_rad_s:>18.4f}"
    hidden = len(poles) - len(shown)
    if hidden:
        yield f"  {'and ' if shown else ''}{hidden} at z = 0"


def _decay_in_words(decay_1_s: float) -> str:
    if decay_1_s < -SLOWEST_DECAY_1_S:
        return f"grows at {-decay_1_s:.4g} 1/s"
    return f"neither decays nor grows (|rate| below {SLOWEST_DECAY_1_S:g} 1/s): the vehicle drifts"


def _margins(loop: SampledLoop) -> Iterator[str]:
    margins = loop.margins(0)
    yield f"  gain    stable between x {margins.gain_min:.4g} and x {margins.gain_max:.4g}"
    if math.isfinite(margins.phase_rad):
        phase_deg = math.degrees(margins.phase_rad)
        yield (
            f"  phase   {margins.phase_rad:.4g} rad ({phase_deg:.1f}°)"
            f" at {margins.crossover_rad_s:.4g} rad/s"
        )


def _delays(loop: SampledLoop) -> Iterator[str]:
    """Return the delay margin and the set of stable delays."""
    last_ms, step_ms = DELAY_NS_MAX // NS_PER_MS, DELAY_STEP_NS // NS_PER_MS
    margin_ns = loop.delay_margin_ns(DELAY_STEP_NS, DELAY_NS_MAX)
    match margin_ns:
        case None:
            margin = f"above {last_ms} ms"
        case 0:
            margin = "none"
        case _:
            margin = f"{margin_ns / NS_PER_MS:.2f} ms"
    stable = loop.stable_delays(DELAY_STEP_NS, DELAY_NS_MAX)
    yield f"  delay margin  {margin}"
    yield f"  stable at     {_ranges(stable)}"
    yield f"                (tested every {step_ms} ms from 0 to {last_ms} ms)"


def _ranges(stable: Sequence[int]) -> str:
    """Return tested delays in ascending order [ns] as ranges without a gap, in milliseconds."""
    if not stable:
        return "none"
    gaps = [(a, b) for a, b in pairwise(stable) if b - a > DELAY_STEP_NS]
    starts = [stable[0], *(b for _, b in gaps)]
    ends = [*(a for a, _ in gaps), stable[-1]]
    return ", ".join(
        f"{start // NS_PER_MS} to {end // NS_PER_MS} ms"
        if end > start
        else f"{start // NS_PER_MS} ms"
        for start, end in zip(starts, ends, strict=True)
    )
