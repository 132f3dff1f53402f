"""Random files as a log: candump's text, and every format that python-can reads.

A log that cannot be read at all raises a LogError of one line; any other has figures. Every frame
is counted once: accepted, late, refused, foreign, or an error frame.
"""

import gzip
import json
import logging
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import can

from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.dbc.messages import SteeringStatus, SteeringStatusCode, encode
from steer_by_wire.runtime.frame.message import message_of
from steer_by_wire.tools.analyze.report import report_html
from tests.fuzz.traffic import noise_of
from tests.support.frames.made_messages import command_of, error_of, message_with

SUFFIXES = (".log", ".txt", ".asc", ".csv", ".trc", ".blf", ".log.gz", ".asc.gz", ".blf.gz")
_PIECES = (
    *(b"9" * 12, b"9" * 400, b"-", b".", b"e9", b"nan", b"\n", b"\0", b'"', b"\xc3\xa9;"),
    *(b"[" * 5_000, b"a" + b".a" * 20_000 + b" = 1\n"),
)
"""Digits and separators, which is what times, lengths and keys of texts are made of."""
_LOGGED = 60
"""Frames of the faultless log that inputs are made from by damaging it."""


def fuzz_log(rng: Random) -> None:
    """Analyse a file that claims to be a log."""
    suffix = rng.choice(SUFFIXES)
    content = _content(rng, suffix)
    logging.getLogger("can").addHandler(logging.NullHandler())
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"fuzzed{suffix}"
        file.write_bytes(content)
        try:
            figures, _ = analyse_files([file])
        except LogError as error:
            text = str(error)
            assert len(text.splitlines()) == 1, f"not one line: {text!r}"
            assert text.startswith(str(file)), f"does not begin with the file: {text}"
            return
    _look(figures)
    report_html("fuzzed", figures, ())


def _look(figures: Mapping[str, Any]) -> None:
    json.dumps(figures)
    messages = figures["messages"].values()
    counted = figures["foreign_frames"] + figures["error_frames"]
    counted += sum(m["accepted"] + m["late"] + sum(m["refused"].values()) for m in messages)
    assert counted == figures["frames"] > 0, f"{figures['frames']} frames, {counted} counted"


def _content(rng: Random, suffix: str) -> bytes:
    """Return the bytes of a file: noise, or a faultless log that is damaged."""
    inner = suffix.removesuffix(".gz")
    if rng.randint(0, 3) == 0:
        content = noise_of(rng)
    else:
        content = damaged(rng, faultless_log(".log" if inner == ".txt" else inner))
    if suffix.endswith(".gz") and rng.random() >= 0.1:
        content = gzip.compress(content, 1)
    return content


def damaged(rng: Random, content: bytes) -> bytes:
    """Return ``content`` with a few pieces replaced, taken out, or put in twice."""
    broken = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        place, size = rng.randint(0, len(broken)), rng.randint(0, 40)
        kind = rng.randint(0, 3)
        if kind == 0:
            broken[place : place + size] = rng.randbytes(size)
        elif kind == 1:
            del broken[place : place + size]
        elif kind == 2:
            broken[place:place] = broken[place : place + size]
        else:
            broken[place : place + 1] = rng.choice(_PIECES)
    return bytes(broken)


@lru_cache
def faultless_log(suffix: str) -> bytes:
    """Return a short log of both nodes in one of python-can's formats."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"faultless{suffix}"
        with can.Logger(file) as writer:
            for message in _messages():
                writer.on_message_received(message)
        return file.read_bytes()


def _messages() -> Iterator[can.Message]:
    for number in range(_LOGGED // 3):
        for frame in (
            encode(error_of(0.01 * number), number),
            encode(command_of(-0.01 * number, number), number),
            encode(
                message_with(
                    SteeringStatus,
                    applied_counter=max(number - 2, 0),
                    status=SteeringStatusCode.APPLYING,
                ),
                number,
            ),
        ):
            message = message_of(frame)
            message.timestamp = 1.6e9 + 0.01 * number
            message.channel = "vcan0"
            yield message
