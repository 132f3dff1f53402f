"""Terminal output of the programs."""

from collections.abc import Sequence

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, ProgressColumn
from rich.table import Table


def plain_console(*, is_error: bool = False) -> Console:
    """Return a console that prints text as it is: brackets are no markup, lines are not wrapped.

    ``is_error``  whether it prints on standard error
    """
    return Console(stderr=is_error, markup=False, highlight=False, soft_wrap=True)


def progress_bars(console: Console, *columns: ProgressColumn) -> Progress:
    """Return bars that disappear at the end; only a terminal shows them."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def counting_bars(console: Console) -> Progress:
    """Return a bar with how many are done and how long the others take."""
    return progress_bars(console, *Progress.get_default_columns(), MofNCompleteColumn())


def plain_table(texts: Sequence[str], numbers: Sequence[str], title: str | None = None) -> Table:
    """Return a table without lines: columns of text by their headings, then of numbers."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.caption_justify = "left"
    for heading in texts:
        table.add_column(heading, no_wrap=True)
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table
