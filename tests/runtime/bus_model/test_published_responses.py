"""The bounds against figures that others have published."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.response_times import Sending, Wire, wire_of, worst_response_ns
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from tests.support.wire.simulated_responses import critical_response_ns

PUBLISHED = tomllib.loads(
    Path(__file__).with_name("published_responses.toml").read_text(encoding="utf-8")
)
DAVIS, BROSTER = PUBLISHED["davis_2007"], PUBLISHED["broster_2002"]
EDGE_NS = 1
"""A frame of lower priority wins the bus a nanosecond before, not at the same time."""


def messages_of(published: Mapping[str, Any], payloads: Sequence[int]) -> list[Sending]:
    """Of the longest frames with 11 bits of identifier: 52 bits and 10 a byte."""
    return [
        Sending(f"m{n}", n, (52 + 10 * size) * bit_ns(published), round(period_ms * 1e6))
        for n, (size, period_ms) in enumerate(zip(payloads, published["period_ms"], strict=True))
    ]


def bit_ns(published: Mapping[str, Any]) -> int:
    return 1_000_000_000 // int(published["bitrate_bit_s"])


def in_ms(messages: Sequence[Sending], wire: Wire, index: int) -> float:
    response_ns = worst_response_ns(messages[index], messages, wire)
    assert response_ns is not None
    return (response_ns + (EDGE_NS if index + 1 < len(messages) else 0)) / 1e6


def test_the_counterexample_of_2007_needs_the_second_instance() -> None:
    messages = messages_of(DAVIS, [DAVIS["payload_bytes"]] * 3)
    wire = wire_of(DAVIS["bitrate_bit_s"])
    # The paper counts a frame with its intermission.
    after_ms = wire.intermission_ns / 1e6
    responses_ms = [in_ms(messages, wire, index) + after_ms for index in range(3)]
    assert responses_ms == pytest.approx(DAVIS["response_ms"])
    late = [r > d for r, d in zip(responses_ms, DAVIS["deadline_ms"], strict=True)]
    assert late == [False, False, True]
    # Before 2007 the first instance alone was looked at, which is all there is of a rare message.
    rare = messages[2]._replace(period_ns=10**9)
    assert in_ms([*messages[:2], rare], wire, 2) + after_ms == pytest.approx(
        DAVIS["response_before_2007_ms"][2]
    )


def test_the_bus_model_shows_the_counterexample() -> None:
    # The longest frame is in no payload that is known: here all take as long as another one.
    bits = frame_bits(Frame(0, b"counter")).nominal
    alike = [Frame(can_id, b"counter") for can_id in range(0x100)]
    alike = [frame for frame in alike if frame_bits(frame).nominal == bits][:3]
    frames = {f"m{n}": frame for n, frame in enumerate(alike)}
    shorter = (bits + 3) / (55 + 10 * DAVIS["payload_bytes"])
    messages = [
        message._replace(
            frame_ns=bits * bit_ns(DAVIS), period_ns=round(message.period_ns * shorter)
        )
        for message in messages_of(DAVIS, [DAVIS["payload_bytes"]] * 3)
    ]
    wire = wire_of(DAVIS["bitrate_bit_s"])
    seen_ns = critical_response_ns(messages[2], messages, frames, BusModel(DAVIS["bitrate_bit_s"]))
    seen_ms = (seen_ns + wire.intermission_ns) / 1e6
    assert seen_ms / shorter == pytest.approx(DAVIS["response_ms"][2])


def test_responses_are_those_of_another_program() -> None:
    messages = messages_of(BROSTER, BROSTER["payload_bytes"])
    wire = wire_of(BROSTER["bitrate_bit_s"])
    for index, response_ms in BROSTER["response_ms"].items():
        assert in_ms(messages, wire, int(index)) == pytest.approx(response_ms)
