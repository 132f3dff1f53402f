"""What else happens on a bus: its bit rate, rest bus, noise, clocks. TOML.

One definition for virtual time, the emulated bus and studies. Times count from the start of the
bus. A node is named as its bus knows it: ``plant`` and ``controller`` in virtual time, the number
of a client on the emulated bus.
"""

from collections.abc import Callable
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..node import NS_PER_S
from ..settings import Settings, SettingsError
from .bit_noise import BusNoise, NoiseRates, StuckLine
from .bus_errors import BusErrors

LEVELS = ("dominant", "recessive")
LOAD_MAX = 1.5
Rate = Annotated[float, Field(ge=0.0, le=0.01)]
Ppm = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]


class BurstSettings(Settings):
    """Times of more errors, which come and go at random (Gilbert and Elliott)."""

    bit_error_rate: Rate
    interval_s: float = Field(ge=0.001, le=3600.0)
    """Mean time from the end of a burst to the next one."""
    length_s: float = Field(ge=0.001, le=60.0)
    """Mean length."""


class StuckSettings(Settings):
    """A time in which the line stays at one level."""

    level: Literal["dominant", "recessive"]
    start_s: float = Field(ge=0.0, le=86_400.0)
    end_s: float = Field(ge=0.0, le=86_400.0)

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> Self:
        if self.end_s < self.start_s:
            raise ValueError(f"end_s must not be before start_s: {self.end_s} < {self.start_s}")
        return self


class ClockSettings(Settings):
    """How much too fast a node's timers run."""

    ppm: Ppm = 0.0
    drift_ppm_s: Ppm = 0.0
    """How fast ``ppm`` changes."""


class BusSettings(Settings):
    """A bus and all that is on it beside the nodes."""

    bitrate_bit_s: int = Field(500_000, ge=10_000, le=1_000_000)
    rest_bus: tuple[str, ...] = ()
    """Databases whose periodic messages are sent too."""
    load: float | None = Field(None, ge=0.0, le=LOAD_MAX)
    """Share of the bus that these take; by default their cycle times decide. Without databases a
    made-up set of messages takes it."""
    bit_error_rate: Rate = 0.0
    """Share of the bits that are wrong for everybody."""
    burst: BurstSettings | None = None
    receiver_bit_error_rate: dict[str, Rate] = Field(default_factory=dict)
    """Share of the bits that one node alone sees wrong, by node."""
    stuck: tuple[StuckSettings, ...] = ()
    needs_acknowledgement: bool = False
    """A frame that no other node acknowledges is an error, as of a node alone on its bus."""
    clock: dict[str, ClockSettings] = Field(default_factory=dict)
    """Oscillators that are off, by node; in virtual time only."""

    @property
    def has_traffic(self) -> bool:
        """Whether there is a rest bus."""
        return self.load != 0.0 and (self.load is not None or bool(self.rest_bus))

    @property
    def has_errors(self) -> bool:
        """Whether anything can go wrong on the wire."""
        return bool(
            self.bit_error_rate
            or self.burst
            or self.receiver_bit_error_rate
            or self.stuck
            or self.needs_acknowledgement
        )

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is on it but the frames of its nodes."""
        return not (self.has_traffic or self.has_errors)

    @property
    def description(self) -> str:
        """What is on it beside the frames of its nodes; empty if nothing."""
        traffic = f"traffic of {', '.join(self.rest_bus) or 'a made message set'}"
        share = "" if self.load is None else f" at {100.0 * self.load:g} %"
        parts = [traffic + share] * self.has_traffic + ["errors"] * self.has_errors
        return " and ".join(parts)


def errors_of(
    settings: BusSettings,
    seed: int,
    number_of: Callable[[str], int],
    is_acknowledged: Callable[[int], bool],
) -> BusErrors | None:
    """Return the errors of a bus; None if it has none.

    ``number_of``        from a node's name to its number on the bus; raises ValueError
    ``is_acknowledged``  whether somebody is there to acknowledge the frames of a sender

    Raises SettingsError for an unknown node.
    """
    if not settings.has_errors:
        return None
    bitrate_bit_s, burst = settings.bitrate_bit_s, settings.burst
    in_bursts = () if burst is None else (burst.bit_error_rate, burst.interval_s, burst.length_s)
    rates = NoiseRates(settings.bit_error_rate, *in_bursts)
    noise_of = {}
    for name, rate in settings.receiver_bit_error_rate.items():
        try:
            node = number_of(name)
        except ValueError as error:
            raise SettingsError(f"receiver_bit_error_rate.{name}: {error}") from error
        noise_of[node] = BusNoise(NoiseRates(rate), bitrate_bit_s, seed + 1 + node)
    stuck = [
        StuckLine(
            LEVELS.index(one.level), round(one.start_s * NS_PER_S), round(one.end_s * NS_PER_S)
        )
        for one in settings.stuck
    ]
    return BusErrors(
        BusNoise(rates, bitrate_bit_s, seed),
        noise_of=noise_of,
        stuck=sorted(stuck, key=lambda line: line.start_ns),
        is_acknowledged=is_acknowledged if settings.needs_acknowledgement else None,
    )
