"""Files that a reproduction writes: PNG and CSV per picture, and a summary as JSON.

The index page is made of the summaries, so that figures computed one by one still end up on one
page.
"""

import csv
import json
import math
from collections.abc import Iterable
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from pydantic import ConfigDict, TypeAdapter

from ...runtime.settings import SettingsError
from .result import Comparison, Picture, Reproduction, Verdict


class Written(NamedTuple):
    """A reproduction without its figures; ``pictures`` are the stems of PNG and CSV."""

    key: str
    title: str
    caption: str
    pictures: tuple[str, ...]
    comparisons: tuple[Comparison, ...]
    verdict: Verdict
    why: str


_RECORD = TypeAdapter(Written, config=ConfigDict(strict=True))


def write_reproduction(reproduction: Reproduction, folder: Path) -> Written:
    """Write all files of a reproduction, the summary last; raises OSError."""
    for picture in reproduction.pictures:
        picture.figure.savefig(folder / f"{picture.name}.png")
        write_columns(picture, folder / f"{picture.name}.csv")
    names = tuple(picture.name for picture in reproduction.pictures)
    written = Written(**reproduction._asdict() | {"pictures": names})
    record = written._asdict() | {
        "comparisons": [comparison._asdict() for comparison in written.comparisons]
    }
    text = json.dumps(record, indent=1, ensure_ascii=False)
    _summary(folder, written.key).write_text(text, encoding="utf-8")
    return written


def write_columns(picture: Picture, file: Path) -> None:
    """Write the data of a picture, with all digits; what is not a number stays empty."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(picture.columns)
        rows = zip_longest(
            *(values.tolist() for values in picture.columns.values()), fillvalue=math.nan
        )
        writer.writerows([_cell(value) for value in row] for row in rows)


def read_written(folder: Path, keys: Iterable[str]) -> list[Written]:
    """Return the summaries in a folder, in the order of ``keys``.

    Raises SettingsError naming an invalid summary.
    """
    files = [_summary(folder, key) for key in keys]
    return [_read(file) for file in files if file.is_file()]


def _summary(folder: Path, key: str) -> Path:
    return folder / f"{key}.json"


def _read(file: Path) -> Written:
    try:
        return _RECORD.validate_json(file.read_bytes())
    except ValueError as error:
        raise SettingsError(
            f"{file}: is not a summary of this program; delete it, or choose another --out"
        ) from error


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
