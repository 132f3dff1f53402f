"""The rule of counters: what becomes of short streams of frames.

A stream is written as groups: ``12* 10a1 5b3`` is, twelve times, after 10 ms the next frame of the
true sender, and 5 ms later a forged one, three counters ahead of that.

    10, 10-, 10+  ms after the frame before; 1 ns less, 1 ns more
    a1, n1        a true frame, one counter after the last; n without content
    b3, b-3       a forged one, three ahead of the last true one, three behind it
    r-3           the true one of three before again

What becomes of it: the results in order, by their letter in LETTERS; the number and letter of the
frame in use, and its age; counters lost, restarts; the age of what was noticed of a second sender.
"""

import re
from collections.abc import Iterator
from itertools import groupby
from types import ModuleType
from typing import NamedTuple

import pytest

from steer_by_wire.dbc.codec import sequence_and_second_sender as sequence
from steer_by_wire.runtime.node import NS_PER_MS

LETTERS = {
    "accepted": "A",
    "confirmed": "C",
    "taken_back": "T",
    "waiting": "W",
    "contradicted": "X",
    "repeated": "R",
    "out_of_order": "O",
    "too_far": "F",
}


class Receiver(NamedTuple):
    """What a receiver believes, and the period that it is told [ms]."""

    lead: int
    resync_run: int
    resync: int
    period: int = 10


RECEIVERS = {
    "acts": Receiver(30, 3, 100),
    "watches": Receiver(30, 3, 0),
    "no lead": Receiver(0, 1, 100),
    "long lead": Receiver(300, 5, 145),
    "fastest": Receiver(0, 3, 0, 0),
}

STREAMS = [
    (
        "watches",
        100,
        "9* 10a1 | 1* 100b0 15-a1 0a1 | 6* 10r-1 | 3* 100b1 100+a2",
        "9A T 2W 6R 6C; 115b 0, lost 4, 0, -",
    ),
    ("watches", 0, "16* 10a1 | 1* 10a1 | 1* 100-b3 | 3* 10a1", "18A 2O T; 15a 0, lost 2, 0, -"),
    (
        "watches",
        0,
        "16* 10a1 | 7* 0b40 100+b0 10a1 | 4* 15b2 100a2 15-a1",
        "16A F T W 2X W 2X W 2X 2W X 2W X 2W X W C X W C X W C X W C X W; 31a 115, lost 15, 0, 15",
    ),
    ("fastest", 0, "1* 10a1 3-b4", "A F; 0a 3, lost 0, 0, -"),
    ("fastest", 0, "1* 10a1 3b4", "2A; 4b 0, lost 3, 0, -"),
    ("no lead", 0, "1* 0a1 0b60", "A F; 0a 0, lost 0, 0, -"),
    ("no lead", 0, "1* 10n1 10-n2", "A F; None 10, lost 0, 0, -"),
    ("watches", 255, "1* 10a1 | 1* 15b0 10000b-2", "A X O; 255a 10015, lost 0, 0, -"),
    ("no lead", 255, "1* 10a1 | 1* 10000-b3 300b1", "2A T; 255a 0, lost 2, 0, -"),
    ("acts", 100, "2* 10a1 | 1* 10-b2", "3A; 103b 0, lost 1, 0, -"),
    ("acts", 100, "1* 10a1 100b-100 10b-99 10b-98", "A 3O; 100a 120, lost 0, 0, -"),
    ("acts", 255, "1* 1000b-1 10a2 50r-3 | 1* 10000-r127", "2A T F; 256a 10000, lost 2, 0, 0"),
    ("no lead", 0, "1* 1000r100 | 1* 100-b6 10a1 0a1", "A 2O A; 1a 0, lost 0, 1, -"),
    ("acts", 100, "1* 0a1 70b-100 10b-99 10b-98 10b-97", "A 3O A; 3b 0, lost 0, 1, -"),
    ("acts", 100, "1* 0a1 70b-100 10b-99 10b-98 10-b-97", "A 4O; 100a 100, lost 0, 0, -"),
    ("acts", 0, "1* 1a1 | 1* 0b-14 | 1* 100+b4 50b-2 0+b-14", "A O A 2O; 4b 50, lost 3, 0, -"),
    (
        "long lead",
        0,
        "1* 10+b2 | 1* 10a1 | 1* 15-b4 10a1 | 1* 10-b126",
        "A O A T F; 4b 10, lost 2, 0, 0",
    ),
    (
        "watches",
        100,
        "1* 10a1 | 1* 0+b-3 | 1* 10a5 10+b127 0+r200",
        "A O A F O; 105a 10, lost 4, 0, -",
    ),
    ("acts", 100, "1* 1a1 | 1* 10000b60 100a20 10a5 | 1* 10a1", "2A 3O; 160b 120, lost 59, 0, -"),
    (
        "watches",
        255,
        "1* 10a1 | 1* 10b-31 | 1* 5a2 | 1* 20b-14 | 1* 15-b-14 10000+b2",
        "A O A O T A; 259b 0, lost 4, 0, 10000",
    ),
    ("acts", 250, "1* 10a1 | 2* 1000-a3 10a128 | 1* 5a5", "2A 2O 2A; 517a 0, lost 8, 0, -"),
    ("acts", 100, "1* 1a1 | 1* 10000b60 100a20 | 3* 10a1", "2A 2O T F; 100a 10, lost 59, 0, -"),
    ("acts", 1, "2* 10+a1 | 1* 1000-a1 15b1 | 2* 10a1 | 1* 15+a1", "4A T 2W; 2a 25, lost 0, 0, -"),
    (
        "watches",
        0,
        "2* 1000a100 10b-2 | 2* 1000+a1 10r-10",
        "A O A O A O A O; 201a 10, lost 99, 0, -",
    ),
    ("long lead", 252, "4* 10a1 | 1* 0b20 | 4* 10a1", "5A 4O; 275b 40, lost 19, 0, -"),
    ("no lead", 250, "3* 15-b2 10a1 20b127", "A O F A T F W X F; 252b 65, lost 0, 0, 0"),
    ("long lead", 100, "8* 10a20 | 1* 1b127", "8A F; 259a 1, lost 133, 0, -"),
    ("no lead", 0, "1* 1a1 | 2* 2000b100 10a5 | 4* 10a1", "2A T 3F 2W C; 12a 0, lost 99, 1, 40"),
    ("acts", 1, "3* 300a5 10a20 50b100 | 1* 100-r5", "A 2F A T X 2W X W; 5a 510, lost 24, 0, 100"),
    ("watches", 0, "12* 10a1 | 1* 2510b-2", "12A O; 11a 2510, lost 0, 0, -"),
    ("no lead", 0, "5* 20a1 | 6* 10a1 | 1* 99b-10 | 3* 10a1", "11A T 3W; 10a 30, lost 0, 0, -"),
    (
        "long lead",
        100,
        "1* 10r-31 | 4* 10a2 10a128 | 4* 15a3 10a1",
        "A F 2O 2A O T 4W 5X; 68a 110, lost 35, 0, 0",
    ),
    (
        "acts",
        0,
        "12* 10a1 | 1* 1b120 9a1 | 1* 1100b120 1b121 1b122 1b123",
        "12A F A 3F A; 135b 0, lost 0, 1, -",
    ),
    (
        "acts",
        0,
        "12* 10a1 | 1* 1b1 9a1 | 6* 10a1 | 3* 5b60 5a1 | 9* 10a1 | 1* 5b0 5a1 10a1 10a1",
        "13A T 2W 4C F C X W X 10W X C W C; 31a 0, lost 20, 0, 25",
    ),
    ("no lead", 128, "1* 10a1 | 64* 10a2 | 1* 500b98", "66A; 354b 0, lost 161, 0, -"),
    (
        "acts",
        0,
        "12* 10a1 | 1* 0b60 | 50* 10a1 | 1* 0b60 | 50* 10a1 | 1* 0b60",
        "12A F 50A F 50A T; 103a 0, lost 0, 0, 0",
    ),
    (
        "acts",
        0,
        "12* 10a1 | 1* 0b60 | 50* 10a1 | 1* 0b60 | 50* 10a1 | 1* 0+b60",
        "12A F 50A F 50A F; 111a 1e-06, lost 0, 0, -",
    ),
    ("no lead", 100, "156* 5a1 | 1* 40a5 500b98", "158A; 358b 0, lost 101, 0, -"),
    (
        "acts",
        0,
        "12* 10a1 | 1* 1b1 9a1 | 262* 10a1 | 1* 110a11 | 12* 10a1",
        "13A T 2W 261C W 11C; 295a 0, lost 19, 0, -",
    ),
    (
        "no lead",
        0,
        "1* 10a1 | 80* 10a2 | 96* 5a1 | 256* 4a1 | 1* 500b110",
        "434A; 622b 0, lost 189, 0, -",
    ),
    (
        "fastest",
        128,
        "127* 10a2 | 1* 50a2 500a3 5+b-100 | 3* 10+a1 10a3 50a1 | 5* 4+a1 5b1 | 2* 5r-31 5+a2",
        "129A O 11A R A T W X W X W O W O W; 400a 43, lost 135, 0, 25",
    ),
    (
        "watches",
        250,
        "8* 10a1 | 1* 4a1 50b20 500b-60 | 40* 2+b60 50b5 5a5 | 1* 10a1 5b-3 5+a1 | 2* 4a3 100b64",
        "9A F O F A T W 2X W 2X W 2X W 2X W 2X W 2X W 2X W 2X W 2X W 96X; 258a 2451, lost 4, 0, 0",
    ),
    (
        "long lead",
        200,
        "126* 1a1 | 2* 500r-100 50b20 50b1 | 5* 2b-100 2+b-120 | 9* 5b-120 | 5* 5a1 5a1",
        "126A O A 2O R O T F X F X F X F X 10F X 3O 6X; 345b 113, lost 19, 0, 45",
    ),
    (
        "fastest",
        128,
        "127* 1a1 | 1* 2+a1 500b127 2a1 | 5* 50r-1 10b127 | 1* 15+r-100 | 3* 1a2",
        "129A 2O A O R O R O R O R A F T X; 383b 1, lost 154, 0, 0",
    ),
    (
        "acts",
        100,
        "7* 4a1 | 120* 4a1 | 5* 100b60 | 9* 4a1 | 5* 50b64 | 120* 4a1 | 1* 2b64 10a1",
        "127A 5F 9A T 4X 24W C 24X 19W 52C X W; 336a 12, lost 13, 1, 10",
    ),
    (
        "acts",
        0,
        "7* 2a1 | 40* 2a1 | 9* 50+b3 2b64 1a5 | 40* 2a1 | 5* 10a1 500a5 | 120* 2a1 | 5* "
        "100+a1 10a1 5a1",
        "48A F 2A F 2A T 2W X 2W X 2W X 2W X 3W X 2W X 37W 50X 38W 46C 2W C 2W C 2W C 2W C "
        "2W; 293a 15, lost 53, 1, 741",
    ),
]
"""The receiver, the number of the first true frame, the stream, and what becomes of it."""

"""What behaves as the original."""


def frames(stream: str, first: int) -> Iterator[tuple[int, int, object]]:
    """Yield time [ns], number and content of the frames of a stream."""
    time_ns, number = 0, first - 1
    for group in stream.split(" | "):
        times, *shots = group.split()
        for shot in shots * int(times.removesuffix("*")):
            match = re.fullmatch(r"(\d+)([+-]?)([abrn])(-?\d+)", shot)
            assert match is not None
            after, ns, letter, step = match.groups()
            time_ns += int(after) * NS_PER_MS + {"+": 1, "-": -1}.get(ns, 0)
            number += int(step) * (letter in "an")
            sent = number + int(step) * (letter in "br")
            yield time_ns, sent, None if letter == "n" else f"{sent}{letter.replace('r', 'a')}"


def heard(tested: ModuleType, name: str, first: int, stream: str) -> str:
    """Return what becomes of a stream."""
    receiver = RECEIVERS[name]
    rule = tested.SequenceRule(
        receiver.lead * NS_PER_MS, receiver.resync_run, receiver.resync * NS_PER_MS
    )
    check, results, now_ns = tested.SequenceCheck(rule, receiver.period * NS_PER_MS), [], 0
    for now_ns, number, content in PARSED[first, stream]:
        results.append(LETTERS[check.check(number % 256, now_ns, content)])
    runs = [(letter, len(list(run))) for letter, run in groupby(results)]
    told = " ".join(f"{count if count > 1 else ''}{letter}" for letter, count in runs)
    ages_ns = [
        None if at is None else now_ns - at for at in (check.arrival_ns, check.second_sender_ns)
    ]
    age, second = ("-" if age is None else f"{age / NS_PER_MS:.6g}" for age in ages_ns)
    return f"{told}; {check.content} {age}, lost {check.lost}, {check.resynchronised}, {second}"


PARSED = {(first, stream): list(frames(stream, first)) for _, first, stream, _ in STREAMS}


def check(tested: ModuleType) -> None:
    assert tested.SequenceRule(0, 1) == (0, 1, 0)
    for bad in ((-1, 1, 0), (0, 0, 0), (0, 1, -1)):
        with pytest.raises(ValueError, match="allowed is"):
            tested.SequenceCheck(tested.SequenceRule(*bad), 1)
    one = tested.SequenceCheck(tested.SequenceRule(0, 1), 1)
    assert one.counter == 0
    one.check(7)
    assert one.arrival_ns == 0
    for row in STREAMS:
        assert heard(tested, *row[:3]) == row[3], row


def test_short_streams_are_received_as_the_rule_says() -> None:
    check(sequence)
