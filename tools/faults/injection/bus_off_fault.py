"""A node's CAN controller that is in bus-off for a while, on an emulated bus.

The broker does it on request and ends it by itself, so that nothing remains when the injector dies.
On a real bus a controller goes into bus-off by errors on the wire, which takes hardware. How the
programs react to that is tested with the kernel's own driver for serial adapters.
"""

from collections.abc import Mapping
from types import MappingProxyType

import can

from ....dbc.messages import CAN_IDS, LateralError, SteeringCommand
from ....runtime.emulated_bus.interface import EmulatedBus
from ....runtime.exit_status import BusError, one_line
from ....runtime.node import NS_PER_S
from ....runtime.port.port import ClosablePort
from ....runtime.port.python_can import BusPort
from ....runtime.settings import SettingsError
from .live_faults import LiveFault

_IDENTIFIERS: Mapping[str, int] = MappingProxyType(
    {"plant": CAN_IDS[LateralError], "controller": CAN_IDS[SteeringCommand]}
)
"""Messages that only that node sends; an intruder that forges them would be taken for it."""


class BusOffFault:
    """One fault of one node's CAN controller; ``close`` ends it if it still lasts.

    Raises SettingsError where the bus cannot do that.
    """

    def __init__(self, fault: LiveFault, start_ns: int, port: ClosablePort | None) -> None:
        bus = port.bus if isinstance(port, BusPort) else None
        if not isinstance(bus, EmulatedBus):
            raise SettingsError(f"{fault.kind}: only on an emulated bus (-i emulated)")
        if not bus.takes_bus_off:
            raise SettingsError(
                f"{fault.kind}: this bus does not take it: start its broker with --allow-bus-off"
            )
        self.fault = fault
        self._bus = bus
        self._plan = [start_ns + round(at_s * NS_PER_S) for at_s in (fault.onset_s, fault.end_s)]

    @property
    def where(self) -> str:
        """The node it acts on."""
        return self.fault.of

    @property
    def next_due_ns(self) -> int | None:
        """When there is something to do next [ns]; None for never."""
        return self._plan[0] if self._plan else None

    def act(self, now_ns: int) -> str:
        """Do what is due; returns the action, empty for none. Raises BusError."""
        if not self._plan or now_ns < self._plan[0]:
            return ""
        self._plan.pop(0)
        if self._plan:
            self._ask(max(self._plan[0] - now_ns, 0) / NS_PER_S)
            return "bus-off"
        self._ask(0.0)
        return "restart"

    def close(self) -> str:
        """End it, if it has begun; returns the action."""
        if len(self._plan) != 1:
            return ""
        self._plan.clear()
        try:
            self._ask(0.0)
        except BusError:
            return ""  # the broker has gone, and bus-off with it
        return "restart"

    def _ask(self, restart_after_s: float) -> None:
        try:
            self._bus.send_bus_off(_IDENTIFIERS[self.fault.of], restart_after_s)
        except can.CanError as error:
            raise BusError(f"cannot ask for a bus-off: {one_line(error)}") from error
