"""The rule of counters in C gives what it gives in Python, with one forged frame on any network."""

import struct
import subprocess
from pathlib import Path

import pytest

from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.codec.sequence_and_second_sender import SequenceCheck, SequenceResult
from steer_by_wire.plant_emulator.network.settings import Order
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.tools.generate_c.law_source import law_source
from steer_by_wire.tools.generate_c.node_source import node_source
from tests.support.attacks.one_forged_frame import CYCLE_NS, Stream, drawn
from tests.support.in_c.law_in_c import STRICT
from tests.support.in_c.node_in_c import settings_of

MAIN = """
#include "sequence.h"
#include <stdio.h>

int main(void)
{
    static uint8_t contents[COUNTERS * 4], came[COUNTERS * 4];
    static struct sequence sequence;
    int64_t words[3];

    while (fread(words, sizeof words, 1, stdin) == 1) {
        const uint8_t content[4] = {(uint8_t)words[2], 0, (uint8_t)words[1], 0};
        int result;

        if (words[0] < 0) {
            sequence_start(&sequence, 4, CYCLE_NS, contents, came);
            continue;
        }
        result = (int)sequence_check(&sequence, content, words[0]);
        printf("%d %d\\n", result, sequence.counter);
    }
    return 0;
}
"""
RESULTS = {
    SequenceResult.ACCEPTED: 1,
    SequenceResult.CONFIRMED: 2,
    SequenceResult.TAKEN_BACK: 3,
    SequenceResult.WAITING: 4,
    SequenceResult.CONTRADICTED: 5,
}
"""``enum sequence_result``; any other is 6."""
SETTINGS = settings_of("practical_pd")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``sequence.c`` with a main function that reads frames and prints what is believed."""
    folder = tmp_path_factory.mktemp("sequence")
    sources = law_source(SETTINGS, "a test") | node_source(SETTINGS, "a test")
    for name, text in {**sources, "main.c": MAIN}.items():
        (folder / name).write_text(text, encoding="utf-8")
    cycle = f"-DCYCLE_NS=INT64_C({CYCLE_NS})"
    build = ["gcc", *STRICT, "-fsanitize=address,undefined", "-O1", cycle, "-o", "main"]
    subprocess.run([*build, "main.c", "sequence.c", "messages.c"], cwd=folder, check=True)
    return folder / "main"


def in_python(stream: Stream) -> list[str]:
    check, lines = SequenceCheck(SETTINGS.counters, CYCLE_NS), []
    for time_ns, number, is_forged in stream.passed:
        counter = (stream.first + number) % COUNTERS
        result = check.check(counter, time_ns, (counter, is_forged))
        lines.append(f"{RESULTS.get(result, 6)} {check.counter}")
    return lines


def test_a_search_finds_no_network_on_which_they_differ(program: Path) -> None:
    streams = [drawn(seed, 60 * NS_PER_MS, list(Order)) for seed in range(40)]
    asked, expected = [], []
    for stream in streams:
        asked.append(struct.pack("=3q", -1, 0, 0))
        asked += [
            struct.pack("=3q", time_ns, (stream.first + number) % COUNTERS, forged)
            for time_ns, number, forged in stream.passed
        ]
        expected += in_python(stream)
    answered = subprocess.run([program], input=b"".join(asked), capture_output=True, check=True)
    assert answered.stdout.decode().splitlines() == expected
