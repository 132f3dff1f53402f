"""Error counters of a CAN controller, and the states they put it in.

Source: ISO 11898-1:2015, fault confinement. Each error of a sender adds 8 and each frame sent
subtracts 1; for a receiver it is 1 and 1.

    error active    both counters below 128: errors are signalled with dominant flags
    error passive   one above 127: recessive flags, and 8 bits of pause after one's own frames
    bus-off         transmit counter above 255: takes no part, until 128 times 11 recessive bits
"""

PASSIVE_MIN, BUS_OFF_MIN = 128, 256
_RECEIVE_AFTER_PASSIVE = 120
"""What the receive counter falls to with the first good frame after error passive: 119 to 127."""


class ErrorCounters:
    """Transmit and receive error counter of one controller (TEC, REC)."""

    def __init__(self) -> None:
        self.transmit = self.receive = 0

    @property
    def is_off(self) -> bool:
        """Whether it is in bus-off."""
        return self.transmit >= BUS_OFF_MIN

    @property
    def is_passive(self) -> bool:
        """Whether its error flags are recessive."""
        return self.transmit >= PASSIVE_MIN or self.receive >= PASSIVE_MIN

    def on_transmit_error(self) -> None:
        """Count an error of a frame of one's own."""
        self.transmit = min(self.transmit + 8, BUS_OFF_MIN)

    def on_receive_error(self) -> None:
        """Count an error of a frame of others; the counter does not grow while passive."""
        if self.receive < PASSIVE_MIN:
            self.receive += 1

    def on_sent(self, frames: int = 1) -> None:
        """Count frames that were sent and acknowledged."""
        if self.transmit:
            self.transmit = max(0, self.transmit - frames)

    def on_received(self, frames: int = 1) -> None:
        """Count frames that were received."""
        if frames and self.receive >= PASSIVE_MIN:
            self.receive, frames = _RECEIVE_AFTER_PASSIVE, frames - 1
        if self.receive:
            self.receive = max(0, self.receive - frames)

    def restart(self) -> None:
        """Begin again after bus-off."""
        self.transmit = self.receive = 0
