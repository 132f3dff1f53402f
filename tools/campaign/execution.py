"""Runs scenarios or walks on processes, and keeps every result the moment it is there.

Results are one JSON object a line. A campaign that is run again with the same specification goes on
where it was left, as long as no program has changed since.
"""

import json
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from hashlib import sha256
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from tools.campaign.specification import CampaignSettings
from tools.campaign.trial import Result, Verdict
from tools.worker_processes import worker_pool

Item = TypeVar("Item")
Done = TypeVar("Done")
RESULTS = "results.jsonl"
_WAITING_PER_PROCESS = 4
_JUDGED = ("controller", "dbc", "plant_emulator", "runtime", "tools.campaign")
_SOURCES = (".py", ".toml", ".dbc")


def specification_hash(spec: CampaignSettings) -> str:
    """Return what tells one specification, of one state of the programs, from another.

    Results of programs that have changed since are no results of these.
    """
    text = spec.model_dump_json(exclude={"residual_frames", "memory_s"})  # no run depends on them
    told = sha256(text.encode())
    for package in _JUDGED:
        for file in sorted(Path(str(files(package))).rglob("*")):
            if file.suffix in _SOURCES:
                told.update(file.read_bytes())
    return told.hexdigest()[:16]


def execute(
    work: Callable[[Item], Done],
    items: Iterable[Item],
    processes: int,
    take: Callable[[Done], None],
) -> None:
    """Do ``work`` for every item, on further processes where there are to be more than one.

    ``work``  found by its name in the other process, as a function of a module is
    ``take``  gets what came of every item, in the order in which they are done

    Raises what ``work`` raises. On Ctrl-C, and where ``take`` raises, what is not done is given up.
    """
    if processes <= 1:
        for item in items:
            take(work(item))
        return
    with worker_pool(processes) as pool:
        source = iter(items)
        waiting: set[Future[Done]] = set()
        while True:
            free = processes * _WAITING_PER_PROCESS - len(waiting)
            waiting |= {pool.submit(work, item) for item in islice(source, free)}
            if not waiting:
                return
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                take(future.result())


def read_results(folder: Path, spec_hash: str | None = None) -> list[Result]:
    """Return the results in a folder; those of ``spec_hash`` alone, if it is given.

    A line that is not whole, as of a run that was killed, is left out.
    """
    file = folder / RESULTS
    if not file.exists():
        return []
    results = []
    for line in file.read_text(encoding="utf-8").splitlines():
        kept = _of_line(line)
        if kept is not None and spec_hash in (None, kept[0]):
            results.append(kept[1])
    return results


def write_result(folder: Path, spec_hash: str, result: Result) -> None:
    """Add a result to those in a folder."""
    with (folder / RESULTS).open("a", encoding="utf-8") as opened:
        opened.write(_line_of(spec_hash, result))


def keep_only(folder: Path, spec_hash: str, results: Iterable[Result]) -> None:
    """Leave these results in a folder, and no others."""
    kept = folder / f"{RESULTS}.new"  # a kill meanwhile leaves those that are there
    kept.write_text("".join(_line_of(spec_hash, result) for result in results), encoding="utf-8")
    kept.replace(folder / RESULTS)


def _line_of(spec_hash: str, result: Result) -> str:
    return json.dumps({"specification": spec_hash, **result._asdict()}) + "\n"


def _of_line(line: str) -> tuple[str, Result] | None:
    try:
        record: dict[str, Any] = json.loads(line)
        spec_hash = str(record.pop("specification"))
        result = Result(**record)
        return spec_hash, result._replace(verdict=Verdict(result.verdict))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
