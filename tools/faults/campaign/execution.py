"""Runs scenarios on processes, and stores every result as soon as it is complete.

Results are one JSON object a line. A campaign that is run again with the same specification
continues where it stopped, as long as no program has changed since. A folder with results of
another campaign is rejected, so that none are lost. A truncated line, from a killed run, is
skipped.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from hashlib import sha256
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from ....closed_loop.processes.parallel_work import worker_pool
from ....plant_emulator.path.settings import WaypointSettings
from ....runtime.output_file import write_text
from ....runtime.sealed_record import sealed, unsealed
from ....runtime.settings import SettingsError
from .campaign_file import CampaignSettings
from .virtual_trial import Detection, RunResult

Item = TypeVar("Item")
Done = TypeVar("Done")
RESULTS = "results.jsonl"
_WAITING_PER_PROCESS = 4
_JUDGED = ("controller", "dbc", "plant_emulator", "runtime", "tools.faults")
_SOURCES = (".py", ".toml", ".dbc")
_LINE_BYTES_MAX = 1 << 20
_WHOLE_MAX = 1 << 53
_FIELDS = TypeAdapter(RunResult, config=ConfigDict(strict=True, allow_inf_nan=False))


class Stored(NamedTuple):
    """Content of a folder.

    ``results``   each with its specification's hash
    ``others``    lines of specifications other than the one asked for, complete or not
    ``not_whole`` lines that are skipped
    """

    results: list[tuple[str, RunResult]]
    others: int
    not_whole: int


def specification_hash(spec: CampaignSettings) -> str:
    """Return what identifies one specification in one state of the programs.

    Results of programs, or of files that it names, that have changed since do not belong to it.
    """
    digest = sha256(spec.model_dump_json().encode())
    paths = [point.path for point in spec.points]
    named = [path.file for path in paths if isinstance(path, WaypointSettings)]
    for file in (*named, *map(Path, spec.command)):
        with suppress(OSError):  # one that is needed is rejected where it is used
            digest.update(file.read_bytes())
    for package in _JUDGED:
        for file in sorted(Path(str(files(f"steer_by_wire.{package}"))).rglob("*")):
            if file.suffix in _SOURCES:
                digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def execute(
    work: Callable[[Item], Done],
    items: Iterable[Item],
    processes: int,
    take: Callable[[Done], None],
) -> None:
    """Do ``work`` for every item, on further processes where more than one is asked for.

    ``work``  is found by its name in the other process: it has to be a function of a module
    ``take``  receives the result of every item, in the order in which they finish

    Raises what ``work`` raises. On Ctrl-C, and where ``take`` raises, unfinished items are dropped.
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


def read_stored(folder: Path, spec_hash: str | None = None) -> Stored:
    """Return everything in a folder; raises SettingsError, and OSError."""
    file = folder / RESULTS
    stored = Stored([], 0, 0)
    if not file.exists():
        return stored
    if not file.is_file():  # a folder cannot be read, and a device may have no end
        raise SettingsError(f"{file}: is not a file")
    others = not_whole = 0
    for line in _lines(file):
        of_hash, result = _of_line(line)
        if result is not None:
            stored.results.append((of_hash, result))
        if of_hash and spec_hash not in (None, of_hash):
            others += 1
        elif result is None:
            not_whole += 1
    return stored._replace(others=others, not_whole=not_whole)


def write_result(folder: Path, spec_hash: str, result: RunResult) -> None:
    """Add a result to those in a folder."""
    with (folder / RESULTS).open("a", encoding="utf-8") as opened:
        opened.write(_line_of(spec_hash, result))


def keep_only(folder: Path, spec_hash: str, results: Iterable[RunResult]) -> None:
    """Write these results to a folder, and no others."""
    lines = "".join(_line_of(spec_hash, result) for result in results)
    write_text(folder / RESULTS, lines)  # if killed meanwhile, the old results remain


def _line_of(spec_hash: str, result: RunResult) -> str:
    return json.dumps(sealed({"specification": spec_hash, **result._asdict()})) + "\n"


def _lines(file: Path) -> Iterator[bytes]:
    with file.open("rb") as opened:
        while line := opened.readline(_LINE_BYTES_MAX):
            if line.strip():
                yield line


def _of_line(line: bytes) -> tuple[str, RunResult | None]:
    """Return a line's hash, empty where there is none, and its result, None if it is incomplete."""
    try:
        record: Any = json.loads(line)
    except (ValueError, RecursionError):  # includes UnicodeDecodeError
        return "", None
    of_hash = record.get("specification", "") if isinstance(record, dict) else ""
    if not (isinstance(of_hash, str) and of_hash):
        return "", None
    try:
        content = unsealed(record)
        del content["specification"]
        result = _FIELDS.validate_python(content)
        result = result._replace(verdict=Detection(result.verdict))
    except (ValidationError, ValueError):
        return of_hash, None
    return of_hash, result if _is_presentable([*result]) else None


def _is_presentable(value: Any) -> bool:
    """Whether tables and figures can be made of it."""
    match value:
        case str():
            return value.isprintable()
        case int():
            return 0 <= value <= _WHOLE_MAX
        case list():
            return all(map(_is_presentable, value))
        case dict():
            return _is_presentable([*value, *value.values()])
    return True
