"""The frames of each kind of fault: some for each place in its sequence, seeded.

The same fault, seed and place give the same frames. Nothing here knows the time: the caller passes
it to ``FrameSource``, which returns when its next frame is due [ns].
"""

import random
from collections.abc import Callable, Iterator, Sequence

from ...dbc.messages import COMMAND_COUNTERS
from ...runtime.frame import Frame
from ...runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from ...runtime.node import NEVER_NS, NS_PER_S
from .forged_frames import ForgedFrames
from .live_faults import LiveFault, LiveKind

PERIOD_NS = 10_000_000
"""Period of forged commands: that of the pair's own."""
FRAMES_AT_ONCE = 200
"""Limit after a stall of the machine; a flood is limited by the bus alone."""
_HIGHEST_PRIORITY_ID = 0x000
Produce = Callable[[int], Sequence[Frame]]
"""Frames of one place in the sequence."""


class FrameSource:
    """Frames of one fault as they become due.

    ``start_ns``  when the onsets' clock starts
    ``produce``   the frames of each place, ``offset_ns`` when its place is after the onset
    ``react``     the frames that follow a received one, if the fault listens
    """

    def __init__(
        self,
        fault: LiveFault,
        start_ns: int,
        produce: Produce,
        offset_ns: Callable[[int], int],
        react: Callable[[Frame], Sequence[Frame]] | None = None,
    ) -> None:
        self.fault = fault
        self.onset_ns = start_ns + round(fault.onset_s * NS_PER_S)
        self.end_ns = start_ns + round(fault.end_s * NS_PER_S)
        self._produce = produce
        self._offset_ns = offset_ns
        self._react = react
        self._index = 0

    @property
    def next_due_ns(self) -> int:
        """When it has the next frame [ns]; NEVER_NS when there is none."""
        due_ns = self.onset_ns + self._offset_ns(self._index)
        return due_ns if due_ns < self.end_ns else NEVER_NS

    def due(self, now_ns: int) -> Iterator[Frame]:
        """Yield what is due; a caller that cannot send one stops, and gets the next one later."""
        for _ in range(FRAMES_AT_ONCE):
            if now_ns >= self.end_ns or self.next_due_ns > now_ns:
                return
            self._index += 1
            yield from self._produce(self._index - 1)

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Return the frames that answer a frame of another sender."""
        if self._react is None or not self.onset_ns <= now_ns < self.end_ns:
            return ()
        return self._react(frame)


def frame_source(
    fault: LiveFault, start_ns: int, seed: int, bitrate_bit_s: int, forged: ForgedFrames
) -> FrameSource:
    """Return the source of a fault.

    ``seed``    of the fault: what is random in it is a function of that and the place
    ``forged``  makes the frames of a bus
    """
    draws = random.Random(seed)  # noqa: S311 it has to be repeatable
    if fault.kind is LiveKind.SPOOF_NEXT:

        def follow(frame: Frame) -> Sequence[Frame]:
            """Forge the next frame of the sender; the true one then arrives as a repetition."""
            following = forged.next_of(frame, fault.magnitude)
            return () if following is None else (following,)

        return FrameSource(fault, start_ns, lambda _: (), lambda _: NEVER_NS, follow)
    if fault.kind is LiveKind.BABBLE:
        return FrameSource(fault, start_ns, _babble, _babble_times(fault, bitrate_bit_s))
    first = draws.randrange(COMMAND_COUNTERS)
    if fault.kind is LiveKind.SPOOF:

        def spoof(index: int) -> Sequence[Frame]:
            return (forged.command(fault.magnitude, first + index),)

        return FrameSource(fault, start_ns, spoof, lambda index: index * PERIOD_NS)
    received = forged.command(0.0, 0), forged.measurement(0)
    period_ns = round(NS_PER_S / fault.magnitude)

    def noise(_index: int) -> Sequence[Frame]:
        return (_noise(draws, received),)

    return FrameSource(fault, start_ns, noise, lambda index: index * period_ns)


def _babble(index: int) -> Sequence[Frame]:
    """Return a frame whose payload counts, so that a recording shows what misses."""
    return (Frame(_HIGHEST_PRIORITY_ID, index.to_bytes(8, "little")),)


def _babble_times(fault: LiveFault, bitrate_bit_s: int) -> Callable[[int], int]:
    if fault.magnitude >= 1.0:
        return lambda _index: 0  # always due; the bus sets the number
    bits = frame_bits(_babble(0)[0]).nominal + INTERMISSION_BITS
    period_ns = round(bits * NS_PER_S / bitrate_bit_s / fault.magnitude)
    return lambda index: index * period_ns


def _noise(draws: random.Random, received: Sequence[Frame]) -> Frame:
    # Half of them under identifiers that a node receives: of all identifiers, hardly any is.
    is_received = draws.random() < 0.5
    chosen = draws.choice(received) if is_received else Frame(draws.randrange(0x800), b"")
    return chosen._replace(data=draws.randbytes(draws.randrange(9)))
