"""A frame that waits for the bus, one that is complete on it, and the totals of a bus."""

from typing import NamedTuple

from ..frame import Frame


class Waiting(NamedTuple):
    """A frame in the queue; sorts by arbitration, then by order of submission."""

    arbitration: int
    sequence: int
    duration_ticks: int
    sender: int
    frame: Frame
    submitted_ticks: int
    buffer: tuple[int, int]


class Delivery(NamedTuple):
    """A frame that is complete on the wire.

    ``end_ns``  time of its end of frame [ns]
    ``sender``  who submitted it
    """

    end_ns: int
    sender: int
    frame: Frame


class BusLoad(NamedTuple):
    """Totals of the bus.

    ``frames``   complete frames
    ``busy_ns``  time they took, intermissions included [ns]
    ``refused``  frames not taken because their transmit buffer was full
    """

    frames: int
    busy_ns: int
    refused: int
