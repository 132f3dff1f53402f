"""What long-running programs show in a terminal."""

from rich.console import Console
from rich.progress import Progress, ProgressColumn


def plain_console() -> Console:
    """Return a console that prints text as it is: brackets are no markup, lines are not wrapped."""
    return Console(markup=False, highlight=False, soft_wrap=True)


def progress_bars(console: Console, *columns: ProgressColumn) -> Progress:
    """Return bars that disappear at the end; only a terminal shows them."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
