"""The counter rule and the alarm of a second sender give in C what they give in Python."""

import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest

from steer_by_wire.dbc.codec.counter_check import CounterCheck
from steer_by_wire.dbc.codec.counter_rule import CounterResult
from steer_by_wire.tools.generate_c.law_source import law_source
from steer_by_wire.tools.generate_c.node_source import node_source
from tests.support.frames.drawn_arrivals import Arrival, drawn_network, drawn_pair
from tests.support.in_c.law_in_c import STRICT
from tests.support.in_c.node_in_c import settings_of

MAIN = """
#include "sequence.h"
#include <stdio.h>

int main(void)
{
    static struct sequence sequence;
    int64_t words[3];

    while (fread(words, sizeof words, 1, stdin) == 1) {
        const uint8_t content[3] = {
            (uint8_t)words[2], (uint8_t)(words[2] >> 8), (uint8_t)words[1],
        };

        if (words[0] < 0) {
            sequence_start(&sequence, CYCLE_NS);
            continue;
        }
        const bool is_accepted = sequence_check(&sequence, content, words[0]);
        printf("%d %d %d\\n", is_accepted, sequence.counter, sequence.had_second);
    }
    return 0;
}
"""
CYCLE_NS = 10_000_000
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


def in_python(arrivals: Sequence[Arrival]) -> list[str]:
    check, lines = CounterCheck(SETTINGS.counters._replace(period_ns=CYCLE_NS)), []
    for time_ns, counter, content in arrivals:
        is_accepted = check.check(counter, time_ns, content) is CounterResult.ACCEPTED
        lines.append(f"{is_accepted:d} {check.counter} {check.second_sender_ns is not None:d}")
    return lines


def test_a_search_finds_no_arrivals_on_which_they_differ(program: Path) -> None:
    random = Random(1)
    drawn = [drawn_network(random)[1] for _ in range(20)]
    drawn += [drawn_pair(random).arrivals for _ in range(20)]
    asked, expected = [], []
    for arrivals in drawn:
        asked.append(struct.pack("=3q", -1, 0, 0))
        asked += [struct.pack("=3q", *arrival) for arrival in arrivals]
        expected += in_python(arrivals)
    answered = subprocess.run([program], input=b"".join(asked), capture_output=True, check=True)
    assert answered.stdout.decode().splitlines() == expected
    assert expected[-1].endswith(" 1")
