"""Write the report of a stress study: a page, its pictures, and the expected cost."""

from pathlib import Path


def write_report(folder: Path) -> Path:
    """Write the report of the study whose results are in ``folder``; returns the page.

    Raises SettingsError where there are no results, OSError where nothing can be written.
    """
    # Pictures and compiled runs take a second to import, which other commands need not wait for.
    from .report import write

    return write(folder)
