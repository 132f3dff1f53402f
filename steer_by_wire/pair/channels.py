"""Opens the best bus of this machine, with a channel for every pair."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ..runtime.bus import socketcan_obstacle
from ..runtime.emulated_bus.launch import launched_broker
from ..runtime.settings import SettingsError
from .live import Bus
from .virtual import BITRATE_BIT_S

BUSES = ("auto", "socketcan", "emulated")


class Channels(NamedTuple):
    """One channel per pair, and a short description of them."""

    buses: tuple[Bus, ...]
    description: str


@contextmanager
def open_channels(
    wanted: str, names: Sequence[str], log: Path, bitrate_bit_s: int = BITRATE_BIT_S
) -> Iterator[Channels]:
    """Make a channel for every name, until the end of the block.

    ``wanted``  socketcan (vcan0, vcan1, ... one a pair), emulated, or auto: socketcan where this
                machine has them all, else emulated
    ``log``     report of the emulated bus on what it carried
    ``bitrate_bit_s``  of the emulated bus

    Raises SettingsError when socketcan is wanted and an interface is missing.
    """
    interfaces = [f"vcan{index}" for index in range(len(names))]
    missing = [name for name in interfaces if socketcan_obstacle(name)]
    if wanted == "socketcan" and missing:
        raise SettingsError(
            f"no CAN interface {', '.join(missing)}; make them with: sudo modprobe vcan; for i in "
            f"{' '.join(missing)}; do sudo ip link add $i type vcan; sudo ip link set $i up; done; "
            "or run below: steer-by-wire with-vcan",
        )
    if wanted != "emulated" and not missing:
        buses = tuple(Bus("socketcan", interface, {}) for interface in interfaces)
        yield Channels(buses, f"SocketCAN {', '.join(interfaces)}")
        return
    options = ["--bitrate", str(bitrate_bit_s)]
    with log.open("w", encoding="utf-8") as output, launched_broker(options, output) as address:
        buses = tuple(Bus("emulated", name, {"address": address}) for name in names)
        count = "1 channel" if len(names) == 1 else f"{len(names)} channels"
        reason = "" if wanted == "emulated" else f" (no {', '.join(missing)} on this machine)"
        yield Channels(
            buses,
            f"emulated CAN bus, {bitrate_bit_s // 1000} kbit/s, {count}{reason}",
        )
