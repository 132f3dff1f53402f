"""What the bus adds to the delay of the steering, beside the delays that each law tolerates."""

from collections.abc import Sequence
from typing import NamedTuple

from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.analysis.stable_delays import delay_margin_ns, stable_delays
from ...controller.laws.law_from_settings import design_law
from ...controller.settings import controller_preset
from ...runtime.settings import SettingsError
from .message_set import BusSettings, SentMessage
from .response_time_bounds import Traffic, load, worst_response_ns

DEFAULT_PRESETS = ("paper_pd", "practical_pd", "practical_pd_ddob")
_LOAD_STEPS = 30
_FASTER_MAX = 1000.0
_NAMES = ("STEERING_COMMAND", "LATERAL_ERROR")


class Tolerance(NamedTuple):
    """One controller.

    ``margin_ns``     constant delay up to which its loop is stable; None beyond the search's limit,
                      0 if it is unstable even without delay
    ``load_max``      load of the steering and of what has priority over it, up to which the bus
                      alone delays less than that; None if it does at any load, 0 if the steering's
                      own two frames take longer
    """

    preset: str
    margin_ns: int | None
    load_max: float | None


class Steering(NamedTuple):
    """The way of a measurement to the controller and of its command back, on the bus alone.

    ``least_ns``, ``most_ns``   both frames alone on the bus, and both bounds
    ``load``                    share of the time that the bus is busy
    """

    least_ns: int
    most_ns: int | None
    load: float
    tolerances: list[Tolerance]


def steering_of(
    messages: Sequence[SentMessage], bus: BusSettings, presets: Sequence[str]
) -> Steering | None:
    """Return what the bus does to the loop; None for a set without the steering's messages."""
    traffic = [m.bound for m in messages]
    steering = [m.bound for m in messages if m.bound.name in _NAMES]
    if len(steering) < len(_NAMES):
        return None
    tolerances = [_tolerance(preset, traffic, bus) for preset in presets]
    return Steering(
        sum(m.frame_ns for m in steering),
        _round_trip_ns(traffic, bus),
        load([m.bound._replace(period_ns=m.mean_period_ns) for m in messages], bus.wire()),
        tolerances,
    )


def _round_trip_ns(traffic: Sequence[Traffic], bus: BusSettings) -> int | None:
    """Bound of both steering messages together [ns]."""
    total_ns = 0
    for message in traffic:
        if message.name in _NAMES:
            bound_ns = worst_response_ns(message, traffic, bus.wire())
            if bound_ns is None:
                return None
            total_ns += bound_ns
    return total_ns


def _tolerance(preset: str, traffic: Sequence[Traffic], bus: BusSettings) -> Tolerance:
    settings = controller_preset(preset)
    design = design_law(settings)
    if settings.model is None or design.looking_back is not None:
        raise SettingsError(
            f"preset {preset} uses past measurements: see steer-by-wire check --preset {preset}"
        )
    loop = SampledLoop(design, settings.model, settings.period_ns)
    margin_ns = delay_margin_ns(stable_delays(loop))
    return Tolerance(preset, margin_ns, _load_max(traffic, bus, margin_ns))


def _load_max(traffic: Sequence[Traffic], bus: BusSettings, margin_ns: int | None) -> float | None:
    """Bisect how much more often the other messages may come; None if they never break the loop."""
    alone_ns = _round_trip_ns(_sped_up(traffic, 0.0), bus)
    if alone_ns is None or (margin_ns is not None and alone_ns > margin_ns):
        return 0.0
    faster_min, faster_max = 0.0, _FASTER_MAX
    for _ in range(_LOAD_STEPS):
        faster = (faster_min + faster_max) / 2
        round_trip_ns = _round_trip_ns(_sped_up(traffic, faster), bus)
        if round_trip_ns is not None and (margin_ns is None or round_trip_ns <= margin_ns):
            faster_min = faster
        else:
            faster_max = faster
    if faster_max == _FASTER_MAX:
        return None
    lowest = max(m.priority for m in traffic if m.name in _NAMES)
    urgent = [m for m in _sped_up(traffic, faster_min) if m.priority <= lowest]
    return load(urgent, bus.wire())


def _sped_up(traffic: Sequence[Traffic], factor: float) -> list[Traffic]:
    return [
        m if m.name in _NAMES else m._replace(period_ns=max(1, round(m.period_ns / factor)))
        for m in traffic
        if m.name in _NAMES or factor > 0
    ]
