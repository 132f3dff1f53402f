"""A real bus for each pair: opened, and joined by programs."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import can

from ...runtime.bus_model.settings import BusSettings
from ...runtime.output_file import write_text
from ...runtime.port.interface_choice import socketcan_obstacle
from ...runtime.settings import SettingsError
from ...runtime.settings.toml_text import dump_toml
from ..processes.process_group import launched_broker
from .rest_bus_from_dbc import traffic_of
from .virtual_bus import QUIET_BUS

BUSES = ("auto", "socketcan", "emulated")


class Bus(NamedTuple):
    """How a program joins one channel: python-can's interface, channel and arguments."""

    interface: str
    channel: str
    arguments: dict[str, str]

    @property
    def options(self) -> list[str]:
        """Options of python-can's command line that join it."""
        options = ["--interface", self.interface, "--channel", self.channel]
        if self.arguments:
            options += ["--bus-kwargs", *(f"{k}={v}" for k, v in self.arguments.items())]
        return options

    def open(self) -> can.BusABC:
        """Join the channel; raises what python-can raises."""
        arguments: dict[str, Any] = dict(self.arguments)
        return can.Bus(interface=self.interface, channel=self.channel, **arguments)


class Channels(NamedTuple):
    """One channel per pair, and a short description of them."""

    buses: tuple[Bus, ...]
    description: str


@contextmanager
def open_channels(
    wanted: str, names: Sequence[str], log: Path, settings: BusSettings = QUIET_BUS, seed: int = 1
) -> Iterator[Channels]:
    """Open the best bus of this machine until the end of the block, with a channel for every name.

    ``wanted``          socketcan (vcan0, vcan1, ... one a pair), emulated, or auto: socketcan where
                        this machine has them all and nothing else is to be on the bus, else
                        emulated
    ``log``             report of the emulated bus on what it carried; its settings go next to it
    ``settings, seed``  of the emulated bus

    Raises SettingsError when socketcan is wanted and an interface is missing, and for databases
    that cannot be sent.
    """
    if wanted == "socketcan" and not settings.is_quiet:
        raise SettingsError(f"{settings.description}: only an emulated bus has these")
    interfaces = [f"vcan{index}" for index in range(len(names))]
    missing = [name for name in interfaces if socketcan_obstacle(name)]
    if wanted == "socketcan" and missing:
        raise SettingsError(
            f"no CAN interface {', '.join(missing)}; make them with: sudo modprobe vcan; for i in "
            f"{' '.join(missing)}; do sudo ip link add $i type vcan; sudo ip link set $i up; done; "
            "or run below: steer-by-wire with-vcan"
        )
    if wanted != "emulated" and settings.is_quiet and not missing:
        buses = tuple(Bus("socketcan", interface, {}) for interface in interfaces)
        yield Channels(buses, f"SocketCAN {', '.join(interfaces)}")
        return
    traffic_of(settings, seed)  # a mistake in a database is reported here, not by the broker
    file = log.with_name("bus.toml")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, dump_toml(settings))
    options = ["--bus-settings", str(file), "--seed", str(seed)]
    with log.open("w", encoding="utf-8") as output, launched_broker(options, output) as address:
        buses = tuple(Bus("emulated", name, {"address": address}) for name in names)
        count = "1 channel" if len(names) == 1 else f"{len(names)} channels"
        description = f"emulated CAN bus, {settings.bitrate_bit_s / 1000:g} kbit/s, {count}"
        if not settings.is_quiet:
            description += f", {settings.description}"
        elif wanted != "emulated":
            description += f" (no {', '.join(missing)} on this machine)"
        yield Channels(buses, description)
