"""The bus between both nodes in virtual time: rest bus, noise and bus-off."""

from collections.abc import Sequence

from ...runtime.bus_model.bus_model import BusModel
from ...runtime.bus_model.rest_bus import Traffic
from ...runtime.bus_model.settings import BusSettings, errors_of
from ...runtime.frame import Frame
from ...runtime.node import ReportingNode, Wrapper
from .rest_bus_from_dbc import traffic_of

QUIET_BUS = BusSettings()
SENDERS = {0: "the plant", 1: "the controller", 2: "the hand wheel"}
"""In the order of the nodes of a virtual pair."""


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


def shared_bus(settings: BusSettings, seed: int) -> BusModel:
    """Return the bus of plant and controller with all that is on it; raises SettingsError.

    A frame of a node that finds its transmit buffer full is lost. Other frames and error frames
    come from negative senders: receive filters of the nodes keep them away.
    """
    traffic, errors = Traffic(traffic_of(settings, seed), seed), errors_of(settings, seed)
    return BusModel(settings.bitrate_bit_s, errors=errors, traffic=traffic, is_lossy=True)


def virtual_bus(settings: BusSettings | None, seed: int) -> BusModel | None:
    """Like ``shared_bus``, but a bus for the nodes alone raises BusOverflowError.

    Without settings there is none: the wire takes no time.
    """
    if settings is None:
        return None
    if not settings.is_quiet:
        return shared_bus(settings, seed)
    return BusModel(settings.bitrate_bit_s, senders=SENDERS)
