"""Lines are few and in the end complete, however fast a node changes."""

from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.view import COUNT_NS, STATE_LINES, STATE_NS, Changes, View

LOOK_NS = NS_PER_S // 20


def state(text: str) -> View:
    return View({"mode": text}, {}, "")


def count(number: int) -> View:
    return View({}, {"frames rejected, bad_crc": number}, "")


def test_a_state_is_one_line_each_time_it_changes() -> None:
    changes = Changes()
    seen = [list(changes.lines(state(text), 10 * STATE_NS * n)) for n, text in enumerate("aabba")]
    assert seen == [["a"], [], ["b"], [], ["a"]]


def test_an_empty_state_is_no_line_but_what_follows_it_is() -> None:
    changes = Changes()
    assert not list(changes.lines(state(""), 0))
    assert list(changes.lines(state("a"), 1)) == ["a"]
    assert not list(changes.lines(state(""), 2))
    assert list(changes.lines(state("a"), 3)) == ["a"]


def test_a_state_that_flutters_is_limited_and_its_last_value_is_not_lost() -> None:
    changes = Changes()
    printed: list[str] = []
    for n in range(200):  # ten seconds
        printed += changes.lines(state("ab"[n % 2]), n * LOOK_NS)
    assert STATE_LINES <= len(printed) <= STATE_LINES + 1 + 10 * NS_PER_S // STATE_NS
    printed += changes.lines(state("c"), 20 * NS_PER_S)
    assert printed[-1] == "c"


def test_a_flood_of_bad_frames_is_counted_in_few_lines() -> None:
    changes = Changes()
    printed: list[str] = []
    for n in range(1, 201):
        printed += changes.lines(count(1000 * n), n * LOOK_NS)
    assert len(printed) == 1 + 199 * LOOK_NS // COUNT_NS
    assert printed[0] == "frames rejected, bad_crc: 1000"
    assert printed[1] == "frames rejected, bad_crc: 100000 more, 101000 so far"


def test_one_cause_does_not_hide_another() -> None:
    changes = Changes()
    assert list(changes.lines(View({}, {"a": 1}, ""), 0)) == ["a: 1"]
    assert list(changes.lines(View({"mode": "on"}, {"a": 2, "b": 1}, ""), 1)) == ["on", "b: 1"]
