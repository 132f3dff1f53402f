"""Second-sender alarm: two senders of one message, noticed by its counters and contents.

One sender uses each counter once in a turn (of 256 in our messages), and its counters form one
sequence. A network
may double, delay and drop its frames, and let them overtake others by less than half a turn. So
either of these shows two senders, once it has gone on for LASTING_NS and TIMES_MIN times:

**Two sequences.** Two sequences of counters, each without a gap, go on next to each other. A
network does the same for a moment, where its latency falls and new frames overtake those that are
still on their way. Only a sudden fall by LASTING_NS is mistaken.

**Two contents.** A counter of the last half turn comes again with another content, newer frames
follow, and so on in turn. This notices two senders whose frames are lost or overtake each other. A
sender that restarts also uses counters again, but its old frames end with those on their way.

Two senders of equal contents under equal counters cannot be told from a network that doubles
frames. The step takes no such frame; ``dbc.codec.sender_watch`` remembers the contents.
"""

from typing import NamedTuple

LASTING_NS = 700_000_000
"""How long two senders go on before they are reported [ns]."""
TIMES_MIN = 8
"""How many frames of each sequence, or changes of the content, there are in that time."""
PAUSE_NS = 300_000_000
"""Without a second content for longer, the next one is the first [ns]."""
SILENCE_NS = 2_000_000_000
"""A sequence that is silent for longer has ended [ns]."""


class SenderState(NamedTuple):
    """State of the watch.

    ``newest``       counter that is furthest ahead
    ``counter``      of the last frame, ``last_ns``: when it came, ``run``: how many before it were
                     of its sequence, since the younger one began
    ``other``, ``other_ns``, ``other_run``  likewise of the other sequence
    ``since_ns``     when the younger sequence began
    ``content_ns``   when a second content last came, ``is_behind``: whether no newer frame has
                     followed it
    ``changes``      how often newer frames have followed one, ``change_ns``: when they first did
    """

    newest: int
    counter: int
    last_ns: int
    run: int
    other: int
    other_ns: int
    other_run: int
    since_ns: int
    content_ns: int
    is_behind: bool
    changes: int
    change_ns: int


def start_senders(counter: int, now_ns: int) -> SenderState:
    """Return the state after the first frame."""
    return SenderState(
        counter, counter, now_ns, 0, counter, now_ns, 0, now_ns,
        now_ns, False, 0, now_ns,
    )  # fmt: skip


def sender_step(
    counters: int, x: SenderState, counter: int, is_second_content: bool, now_ns: int
) -> tuple[SenderState, bool]:
    """Return the state after a frame, and whether it shows a second sender.

    ``counters``           number of values of the counter
    ``is_second_content``  whether its counter has come with another content in the last half turn
    """
    if counters == 0:
        return x, False
    forward = (counter - x.newest) % counters
    is_ahead = forward > 0 and forward <= counters // 2
    newest = counter if is_ahead else x.newest
    content_ns, is_behind, changes, change_ns = x.content_ns, x.is_behind, x.changes, x.change_ns
    shows = False
    if is_second_content:
        if now_ns - content_ns > PAUSE_NS:
            changes = 0
        shows = not is_behind and changes >= TIMES_MIN and now_ns - change_ns >= LASTING_NS
        content_ns, is_behind = now_ns, True
    elif is_ahead and is_behind:
        change_ns = now_ns if changes == 0 else change_ns
        changes, is_behind = changes + 1, False
    run, since_ns, other, other_ns, other_run = 0, now_ns, x.counter, x.last_ns, 0
    if counter == (x.counter + 1) % counters:
        run, since_ns = x.run + 1, x.since_ns
        other, other_ns, other_run = x.other, x.other_ns, x.other_run
    elif counter == (x.other + 1) % counters and now_ns - x.other_ns <= SILENCE_NS:
        run, since_ns, other_run = x.other_run + 1, x.since_ns, x.run
        is_lasting = min(run, other_run) >= TIMES_MIN and x.last_ns - since_ns >= LASTING_NS
        shows = shows or is_lasting
    state = SenderState(
        newest, counter, now_ns, run, other, other_ns, other_run, since_ns,
        content_ns, is_behind, changes, change_ns,
    )  # fmt: skip
    return state, shows
