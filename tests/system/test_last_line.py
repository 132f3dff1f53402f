"""The line that a run of the suite ends with."""

from types import SimpleNamespace

from tests.support.suite.last_line import last_line


def skipped(reason: str) -> SimpleNamespace:
    return SimpleNamespace(longrepr=("tests/test_some.py", 7, f"Skipped: {reason}"))


def test_it_counts_what_has_passed_and_groups_what_has_not_run_by_its_reason() -> None:
    reports = {
        "passed": [SimpleNamespace()] * 3,
        "skipped": [skipped("no bus"), skipped("no compiler"), skipped("no bus")],
    }
    assert last_line(reports) == "3 passed, 3 skipped (2: no bus; 1: no compiler)"


def test_it_counts_what_has_failed() -> None:
    reports = {"failed": [SimpleNamespace()], "error": [SimpleNamespace()] * 2}
    assert last_line(reports) == "0 passed, 1 failed, 2 errors, 0 skipped"
