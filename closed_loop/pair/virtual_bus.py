"""The bus between both nodes in virtual time: rest bus, noise and bus-off."""

from collections.abc import Sequence

from ...runtime.bus_model.bus_errors import BusErrors
from ...runtime.bus_model.bus_model import BusModel, Delivery
from ...runtime.bus_model.quiet_bus import QuietBus
from ...runtime.bus_model.rest_bus import PeriodicMessage, RestBus
from ...runtime.bus_model.settings import BusSettings, errors_of
from ...runtime.bus_model.transmit_queue import BusOverflowError
from ...runtime.frame import Frame
from ...runtime.node import ReportingNode, Wrapper
from .rest_bus_from_dbc import traffic_of

QUIET_BUS = BusSettings()


class Controlled(Wrapper[ReportingNode]):
    """A node behind its CAN controller: in bus-off it gets no frames.

    ``index``  of the node on the bus ``model``
    """

    def __init__(self, node: ReportingNode, index: int, model: BusModel) -> None:
        super().__init__(node)
        self._index, self._model = index, model

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node."""
        is_off = self._model.is_off(self._index, now_ns)
        return () if is_off else self.node.on_frame(frame, now_ns)


class SharedBus:
    """A bus with a rest bus on it, for a virtual-time executor.

    ``messages``  of the rest bus
    ``seed``      of their phases
    ``errors``    of the bus, if it has any

    ``next_event_ns``  when the next frame may be complete [ns]
    ``refused``        frames of the nodes that found their transmit buffer full and are lost

    Its frames and error frames come from negative senders: receive filters of the nodes keep them
    away.
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        messages: Sequence[PeriodicMessage] = (),
        seed: int = 0,
        errors: BusErrors | None = None,
    ) -> None:
        self.traffic = RestBus(messages, seed) if messages else None
        self.errors = errors
        self.model = BusModel(bitrate_bit_s, errors=errors, traffic=self.traffic)
        self.next_event_ns = self.model.next_event_ns
        self.refused = 0

    def behind_controller(self, node: ReportingNode, index: int) -> ReportingNode:
        """Return a node that gets no frames in bus-off."""
        return node if self.errors is None else Controlled(node, index, self.model)

    @property
    def busy_share(self) -> float:
        """Share of the time so far that the bus was busy, 0 to 1."""
        return self.model.load.busy_ns / max(self.model.load_until_ns, 1)

    def advance(self, now_ns: int) -> Sequence[Delivery]:
        """Return the frames completed up to ``now_ns``, in order of completion."""
        completed = self.model.advance(now_ns)
        self.next_event_ns = self.model.next_event_ns
        return completed

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Take a frame of a node, if there is room."""
        try:
            self.model.submit(frame, sender, now_ns)
        except BusOverflowError:
            self.refused += 1
        self.next_event_ns = self.model.next_event_ns


def shared_bus(settings: BusSettings, seed: int) -> SharedBus:
    """Return the bus of plant and controller in virtual time; raises SettingsError."""
    errors = errors_of(settings, seed)
    return SharedBus(settings.bitrate_bit_s, traffic_of(settings, seed), seed, errors)


def virtual_bus(settings: BusSettings, seed: int) -> QuietBus | SharedBus:
    """Like ``shared_bus``, but the cheaper QuietBus if there is no other traffic and no error."""
    return QuietBus(settings.bitrate_bit_s) if settings.is_quiet else shared_bus(settings, seed)
