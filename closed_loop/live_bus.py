"""A real bus for each pair: opened, joined by programs, and recorded."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

import can

from ..runtime.bus_model.settings import BusSettings
from ..runtime.exit_status import cause_of
from ..runtime.output_file import write_text
from ..runtime.port.interface_choice import socketcan_obstacle
from ..runtime.settings import SettingsError
from ..runtime.settings.toml_text import dump_toml
from .process_group import launched_broker
from .rest_bus_from_dbc import traffic_of
from .virtual_bus import QUIET_BUS

BUSES = ("auto", "socketcan", "emulated")
_PAUSE_S = 0.1
"""Without a frame for so long, a recorder has all that was sent."""
_BEHIND_S_MAX = 10.0


class Bus(NamedTuple):
    """How a program joins one channel: python-can's interface, channel and arguments."""

    interface: str
    channel: str
    arguments: dict[str, str]

    @property
    def options(self) -> list[str]:
        """The same as python-can's command line options."""
        options = ["--interface", self.interface, "--channel", self.channel]
        if self.arguments:
            options += ["--bus-kwargs", *(f"{k}={v}" for k, v in self.arguments.items())]
        return options

    def open(self) -> can.BusABC:
        """Join the channel; raises what python-can raises."""
        arguments: dict[str, Any] = dict(self.arguments)
        return can.Bus(interface=self.interface, channel=self.channel, **arguments)


class BusRecorder:
    """Records every frame on a bus, in a thread, from the start of a ``with`` block to its end.

    At the end it still takes what was sent before: a busy machine may be seconds behind.

    ``failure``  why the log ends early, empty if it does not: a bus drops a recorder that reads too
                 slowly, and a disk may be full
    """

    def __init__(self, bus: Bus, candump_log: Path) -> None:
        """Record into ``candump_log``, as ``candump -L`` prints it."""
        self._bus, self._candump_log = bus, candump_log
        self.failure = ""

    def __enter__(self) -> Self:
        self._listener = self._bus.open()
        self._writer = can.CanutilsLogWriter(self._candump_log, channel=self._bus.channel)
        self._notifier = can.Notifier([], [self], timeout=_PAUSE_S)
        self._notifier.add_bus(self._listener)  # its thread may fail at once
        return self

    def __exit__(self, *_: object) -> None:
        end_s = time.time()
        self._notifier.stop()
        try:
            self._take_waiting(end_s)
        except (OSError, can.CanError) as error:
            self.failure = self.failure or cause_of(error)
        try:
            self._writer.stop()
        except OSError as error:
            self.failure = self.failure or cause_of(error)
        self._listener.shutdown()

    def _take_waiting(self, end_s: float) -> None:
        """Write the frames that were sent before a time of the wall clock [s]."""
        until_s = time.monotonic() + _BEHIND_S_MAX
        while not self.failure and (message := self._listener.recv(_PAUSE_S)) is not None:
            if message.timestamp > end_s:  # other people's traffic goes on
                return
            if time.monotonic() > until_s:
                self.failure = f"was still behind {_BEHIND_S_MAX:g} s after its end"
            self._writer(message)

    def __call__(self, message: can.Message) -> None:
        """Write a frame."""
        self._writer(message)

    def on_error(self, error: Exception) -> None:
        """End the recording, and nothing else."""
        self.failure = cause_of(error)
        self._notifier.stop(0.0)


class Channels(NamedTuple):
    """One channel per pair, and a short description of them."""

    buses: tuple[Bus, ...]
    description: str


@contextmanager
def open_channels(
    wanted: str,
    names: Sequence[str],
    log: Path,
    settings: BusSettings = QUIET_BUS,
    seed: int = 1,
) -> Iterator[Channels]:
    """Open the best bus of this machine until the end of the block, with a channel for every name.

    ``wanted``          socketcan (vcan0, vcan1, ... one a pair), emulated, or auto: socketcan where
                        this machine has them all and nothing else is to be on the bus, else
                        emulated
    ``log``             report of the emulated bus on what it carried; its settings go beside it
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
            "or run below: steer-by-wire with-vcan",
        )
    if wanted != "emulated" and settings.is_quiet and not missing:
        buses = tuple(Bus("socketcan", interface, {}) for interface in interfaces)
        yield Channels(buses, f"SocketCAN {', '.join(interfaces)}")
        return
    traffic_of(settings, seed)  # a mistake in a database is reported here, not by the broker
    file = log.with_name("bus.toml")
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
