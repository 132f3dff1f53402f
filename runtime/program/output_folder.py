"""The folder of ``--out``, in which no run overwrites the results of another."""

from collections.abc import Mapping
from pathlib import Path

from ..settings import SettingsError


def refuse_another_run(folder: Path, wanted: Mapping[str, str | None]) -> None:
    """Refuse an ``--out`` that has another run; raises SettingsError.

    ``wanted``  the files that say what the results are of, by name: the text of each, None where
                this run has no such file
    """
    for name, text in wanted.items():
        file = folder / name
        if file.exists() and (
            text is None or file.read_bytes() != text.encode(errors="surrogateescape")
        ):
            raise SettingsError(
                f"--out {folder} has another run, whose {name} differs: give another folder, or"
                " remove that one"
            )
