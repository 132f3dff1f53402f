"""The ghost: the visitor's car as the predictor would steer it through the same network.

Both nodes of a pair in virtual time, on the clock of this machine since the visitor's first
command. Seed and latency are those of the visitor's plant, so every frame meets the same network.
"""

import math

from ...closed_loop.pair.virtual_pair import make_virtual_pair
from ...controller.settings import controller_preset
from ...dbc.messages import CAN_IDS, Decoded, LateralError, decode
from ...plant_emulator.settings import PlantSettings
from ...runtime.frame import Frame
from ...runtime.node.virtual_time_loop import VirtualTimeExecutor

_LAW = "highway_stiff_predictor"
_ERROR_ID = CAN_IDS[LateralError]


_UNKNOWN = LateralError(math.nan, math.nan)


class Ghost:
    """Drives from ``begin`` on."""

    def __init__(self, plant: PlantSettings) -> None:
        self._settings, self._law = plant, controller_preset(_LAW)
        self.restart()

    def restart(self) -> None:
        """Wait at the start of the path."""
        self._pair = make_virtual_pair(self._settings, self._law, plant_samples_max=0)
        nodes = (self._pair.edge, self._pair.controller)
        self._executor = VirtualTimeExecutor(nodes, on_wire=self._on_wire)
        self._start_ns: int | None = None
        self._error = _UNKNOWN

    def begin(self, now_ns: int) -> None:
        """Start, unless it drives already."""
        if self._start_ns is None:
            self._start_ns = now_ns

    def configure(self, frame: Frame, now_ns: int) -> None:
        """Let a tool's frame act on this car too: latency or disturbance."""
        self.at(now_ns)
        self._pair.edge.on_frame(frame, self._executor.now_ns)

    def at(self, now_ns: int) -> LateralError:
        """Return where it is against the path."""
        if self._start_ns is not None:
            self._executor.run(now_ns - self._start_ns)
        return self._error

    def _on_wire(self, _time_ns: int, _sender: int, frame: Frame) -> None:
        if frame.can_id != _ERROR_ID:
            return
        decoded = decode(frame)
        if isinstance(decoded, Decoded) and isinstance(decoded.message, LateralError):
            self._error = decoded.message
