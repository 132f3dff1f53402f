"""The option ``--dialect`` of the programs; without it nothing here reads a database."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.frame import EXTENDED, FD
from ...runtime.node import ReportingNode, innermost
from ...runtime.program.run_node import run_node
from ...runtime.settings import Settings, SettingsError
from ..secoc.key_option import Program, run_secured_node
from .listening import OURS, Listening

if TYPE_CHECKING:
    from .dialect import Dialect


def add_dialect_argument(
    parser: argparse.ArgumentParser, what: str = "speak the messages of a car on the bus"
) -> None:
    """Add ``--dialect``."""
    parser.add_argument("--dialect", type=Path, metavar="CAR.toml", help=what)


def dialect_of(file: Path | None) -> "Dialect | None":
    """Return the dialect of a file; raises SettingsError."""
    if file is None:
        return None
    from .dialect import read_dialect

    return read_dialect(file)


def listening_in(file: Path | None) -> Listening:
    """Return how one who only listens understands a bus; without a dialect it speaks our own."""
    dialect = dialect_of(file)
    if dialect is None:
        return OURS
    from .overheard import Overheard

    return Overheard(dialect)


def run_in_dialect(
    program: Program,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], ReportingNode],
    conclude: Callable[[Any], None],
    dialect: "Dialect | None",
) -> ExitStatus:
    """Run a node that speaks a dialect; without one, as ``run_secured_node`` does."""
    if dialect is None:
        return run_secured_node(program, options, settings, make_node, conclude)
    if options.key_file is not None:
        raise SettingsError("--dialect takes no --key-file: a car's frames are not authenticated")
    from .gateway import dialect_text

    received = dialect.sent_by(program.end.peer)
    if any(one.flags & FD for one in dialect.messages):
        options.fd = True
    has_extended = any(one.flags & EXTENDED for one in received)
    can_ids = None if has_extended else {*dialect.kept_ids, *(one.can_id for one in received)}

    def conclude_in_dialect(node: ReportingNode) -> None:
        say(program.name, f"dialect: {dialect_text(node.report()['dialect'])}")
        conclude(innermost(node))

    notice = f"speaks {options.dialect.name}; frames of a car are not authenticated"
    run = program.name, options, settings, make_node, conclude_in_dialect
    return run_node(*run, can_ids, notice, program.ending)
