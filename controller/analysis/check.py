"""What ``steering-controller --check`` prints: the settings in effect, and what the loop tolerates.

The text as a whole is a settings file again: all but the settings are TOML comments.
"""

import math
from collections.abc import Callable, Generator, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.toml_text import dump_toml
from ..design import LawDesign, design_law, link_of, vehicle_of
from ..law_record import LookingBack
from ..link import LinkParams
from ..nominal_model import NominalVehicle
from ..settings import ControllerSettings
from .check_verdict import NOT_ANALYSED, Found, found_of
from .linear_system import NotLinearError, law_system
from .looking_back import Rig
from .predictor_loop import PredictorLoop, stable_constant_delays
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop
from .stable_delays import DELAY_NS_MAX, DelayInterval, delay_margin_ns, stable_delays

JITTER_MEANS_MS = (80, 160)
JITTER_LOSS = 0.01
SHOWN_DELAYS_MS = (0, 100, 200, 300, 400, 500)
FILTER_PERIODS_MAX = 100
"""Largest delay for a law with a filter: every command in transit is a state, and the search with a
hundred of them at each delay takes a minute in total."""
_MODULUS_SHOWN_MIN = 1e-3
"""Poles closer to z = 0 belong to memory that is empty after a few periods."""
_RESOLUTION_NS = 10_000
_RANGES_PER_LINE = 3


Lines = Generator[str, None, Found]
"""Lines of the analysis, which returns what it found."""


def check_text(settings: ControllerSettings) -> str:
    """Return the settings and the analysis of their loop around the nominal plant."""
    return check(settings)[0]


def check(settings: ControllerSettings) -> tuple[str, Found]:
    """Return ``check_text``, which ends with the verdict, and what was found."""
    comments = [_rate(settings), ""]
    analysis = _analysis(settings)
    while True:
        try:
            comments.append(next(analysis))
        except StopIteration as end:
            found: Found = end.value
            break
    comments += ["", f"verdict: {found}"]
    lines = [f"# {comment}" if comment else "#" for comment in comments]
    return "\n".join([dump_toml(settings), *lines, ""]), found


def _rate(settings: ControllerSettings) -> str:
    rate_hz = NS_PER_S / settings.period_ns
    return f"Runs at {rate_hz:.9g} Hz, every {settings.period_ns} ns."


def _analysis(settings: ControllerSettings) -> Lines:
    design, period_ns = design_law(settings), settings.period_ns
    if design.looking_back is not None:
        return (yield from _looking_back_analysis(settings, design, design.looking_back))
    if settings.feed_forward is not None:
        yield "The feed-forward of the curve is outside the loop: it changes none of what follows."
        yield ""
    try:
        law = law_system(design)
    except NotLinearError as error:
        yield f"Not analysed: {error}."
        return NOT_ANALYSED
    yield "Poles of the law alone:"
    law_poles = np.linalg.eigvals(law.a).astype(np.complex128)
    yield from _poles(law_poles, period_ns)
    yield ""
    if settings.model is None:
        yield "There is no [nominal_model], hence no closed loop to analyse."
        return NOT_ANALYSED
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
    stable = stable_delays(loop)
    yield "Constant delay between command and wheel angle:"
    yield from _delays(stable)
    if stable:
        yield ""
        yield (
            "Latency drawn anew for each command (gamma, newest wins,"
            f" {100.0 * JITTER_LOSS:g} % lost), standard deviation:"
        )
        yield from _jitter(loop)
    return found_of(stable)


def _looking_back_analysis(
    settings: ControllerSettings, design: LawDesign, law: LookingBack
) -> Lines:
    """Return the analysis of a law that is linear at a constant latency only."""
    link, model = link_of(settings), vehicle_of(settings)
    vehicle = NominalVehicle(**model.model_dump(exclude={"kind"}))
    yield from law.opening
    yield ""
    found = yield from _looking_back(
        lambda: PredictorLoop(design, link, Rig(vehicle), law.state_period_ns, law.request_periods),
        link,
    )
    yield ""
    if law.fallback is not None and settings.model is not None:
        name, when = law.fallback
        yield f"{when}, the law is {name}, with a"
        fallback = design_law(settings.model_copy(update={"law": name}))
        loop = SampledLoop(fallback, settings.model, settings.period_ns)
        yield from _delays(stable_delays(loop))
        yield "around the nominal plant. A heavier or a faster vehicle bears less delay; --law"
        yield f"{name} --check analyses it."
    yield from law.closing
    yield "Latency that varies is for simulation: steer-by-wire stress."
    return found


def _looking_back(make_loop: Callable[[], PredictorLoop], link: LinkParams) -> Lines:
    """Return poles, sensitivity and stable delays of a law that looks back."""
    try:
        loop = make_loop()
    except ValueError as error:
        yield f"Not analysed: {error}."
        return NOT_ANALYSED
    yield "Poles of the closed loop around the nominal plant, without delay:"
    yield from _poles(loop.closed_loop_poles(0), loop.period_ns)
    yield ""
    yield "Sensitivity, and steer for a noise of 1 m RMS in every lateral error:"
    for delay_ms in SHOWN_DELAYS_MS:
        if delay_ms * NS_PER_MS <= FILTER_PERIODS_MAX * link.period_ns:
            yield f"  {delay_ms:>3} ms   {_noise_and_sensitivity(loop, delay_ms * NS_PER_MS)}"
    yield ""
    limit_ns = min(DELAY_NS_MAX, FILTER_PERIODS_MAX * link.period_ns)
    yield "Constant delay between command and wheel angle:"
    stable = stable_constant_delays(loop, limit_ns)
    yield from _delays(stable, limit_ns)
    return found_of(stable, limit_ns)


def _noise_and_sensitivity(loop: PredictorLoop, delay_ns: int) -> str:
    decay_1_s = loop.decay_1_s(delay_ns)
    if decay_1_s <= SLOWEST_DECAY_1_S:
        return f"NOT STABLE, its slowest mode {_decay_in_words(decay_1_s)}"
    noise = f"{loop.noise_gain_rad_m(delay_ns):.4g} rad"
    return f"sensitivity at most {loop.peak_sensitivity(delay_ns):.4g}, {noise}"


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
    yield f"  gain         stable between x {margins.gain_min:.4g} and x {margins.gain_max:.4g}"
    if math.isfinite(margins.phase_rad):
        phase_deg = math.degrees(margins.phase_rad)
        yield (
            f"  phase        {margins.phase_rad:.4g} rad ({phase_deg:.1f}°)"
            f" at {margins.crossover_rad_s:.4g} rad/s"
        )
    yield (
        f"  sensitivity  at most {margins.peak_sensitivity:.4g},"
        f" at {margins.peak_sensitivity_rad_s:.4g} rad/s"
    )


def _delays(stable: tuple[DelayInterval, ...], limit_ns: int = DELAY_NS_MAX) -> Iterator[str]:
    """Return the delay margin and the set of stable delays."""
    limit_ms = limit_ns // NS_PER_MS
    match delay_margin_ns(stable, limit_ns):
        case None:
            margin = f"above {limit_ms} ms"
        case 0:
            margin = "none"
        case margin_ns:
            margin = f"{_ms_rounded_down(margin_ns)} ms"
    yield f"  delay margin  {margin}"
    ranges = [f"{_ms_rounded_up(first)} to {_ms_rounded_down(last)} ms" for first, last in stable]
    yield from _wrapped("  stable at     ", ranges or ["no delay"])
    yield f"                (searched from 0 to {limit_ms} ms)"


def _jitter(loop: SampledLoop) -> Iterator[str]:
    """Return which standard deviations of the latency are tolerated at some mean latencies."""
    # Imports scipy for the gamma distribution, which a running node has no use for.
    from .jitter import JitterTooLargeError, stable_spreads

    for mean_ms in JITTER_MEANS_MS:
        heading = f"  mean {mean_ms:>3} ms   "
        try:
            spreads = stable_spreads(loop, mean_ms * NS_PER_MS, JITTER_LOSS)
        except JitterTooLargeError:
            yield f"{heading}too many commands on their way at this rate to be analysed"
            continue
        ranges = [
            f"{math.ceil(first / NS_PER_MS)} to {last // NS_PER_MS} ms" for first, last in spreads
        ]
        yield from _wrapped(heading, ranges or ["no standard deviation"])
    yield "                (mean-square stability, searched from 0 to the mean)"


def _wrapped(heading: str, ranges: Sequence[str]) -> Iterator[str]:
    """Return ranges in lines of a few each, the first line behind a heading."""
    for start in range(0, len(ranges), _RANGES_PER_LINE):
        line = ", ".join(ranges[start : start + _RANGES_PER_LINE])
        more = "," if start + _RANGES_PER_LINE < len(ranges) else ""
        yield f"{heading if start == 0 else ' ' * len(heading)}{line}{more}"


def _ms_rounded_down(time_ns: int) -> str:
    return f"{time_ns // _RESOLUTION_NS * _RESOLUTION_NS / NS_PER_MS:.2f}"


def _ms_rounded_up(time_ns: int) -> str:
    return f"{-(-time_ns // _RESOLUTION_NS) * _RESOLUTION_NS / NS_PER_MS:.2f}"
