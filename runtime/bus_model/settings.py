"""Settings of the bus: bit rate, other traffic, bit errors (TOML).

One definition for virtual time, the emulated bus and studies.
"""

from typing import Annotated

from pydantic import Field

from ..settings import Settings
from .bus_errors import BusErrors, BusNoise

LOAD_MAX = 1.5
Rate = Annotated[float, Field(ge=0.0, le=0.01)]


class BusSettings(Settings):
    """A bus, and all that is on it with the nodes."""

    bitrate_bit_s: int = Field(500_000, ge=10_000, le=1_000_000)
    rest_bus: tuple[str, ...] = ()
    """Databases whose periodic messages are sent too."""
    load: float | None = Field(None, ge=0.0, le=LOAD_MAX)
    """Share of the bus that these take; by default their cycle times decide. Without databases a
    made-up set of messages takes it."""
    bit_error_rate: Rate = 0.0
    """Share of the bits that are wrong; in virtual time only."""

    @property
    def has_traffic(self) -> bool:
        """Whether there is a rest bus."""
        return self.load != 0.0 and (self.load is not None or bool(self.rest_bus))

    @property
    def has_errors(self) -> bool:
        """Whether anything can go wrong on the wire."""
        return bool(self.bit_error_rate)

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is on it but the frames of its nodes."""
        return not (self.has_traffic or self.has_errors)

    @property
    def description(self) -> str:
        """What is on it with the frames of its nodes; empty if nothing."""
        traffic = f"traffic of {', '.join(self.rest_bus) or 'a made message set'}"
        share = "" if self.load is None else f" at {100.0 * self.load:g} %"
        parts = [traffic + share] * self.has_traffic + ["errors"] * self.has_errors
        return " and ".join(parts)


def errors_of(settings: BusSettings, seed: int) -> BusErrors | None:
    """Return the errors of a bus; None if it has none."""
    if not settings.has_errors:
        return None
    noise = BusNoise(settings.bit_error_rate, settings.bitrate_bit_s, seed)
    return BusErrors(noise.first_hit_ns)
