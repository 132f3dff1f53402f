"""The option ``--dialect`` of the programs; without it nothing here reads a database."""

import argparse
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.frame import EXTENDED, FD
from ...runtime.node import N, ReportingNode
from ...runtime.program.fail_if_conditions import Ending
from ...runtime.program.run_node import run_node
from ...runtime.settings import Settings, SettingsError
from ..messages import Message
from ..secoc.key_option import run_secured_node
from ..secoc.secured_frame import PLANT, End
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


def run_node_in_dialect(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    end: End,
    make_node: Callable[[int], N],
    known: Collection[type[Message]],
    conclude: Callable[[N], None],
    ending: Ending,
    dialect: "Dialect | None",
    law: str = "",
    edge_of: Callable[[ReportingNode], ReportingNode] = lambda node: node,
) -> ExitStatus:
    """Run a node as ``run_secured_node`` does, behind a gateway if a dialect is given.

    ``law``      of a controller that reads VEHICLE_STATE; empty for one that does not
    ``edge_of``  returns what stands between the node, in its dialect, and the bus
    """
    made: list[N] = []

    def make(start_ns: int) -> N:
        made.append(make_node(start_ns))
        return made[-1]

    if dialect is None:
        return run_secured_node(
            name,
            options,
            settings,
            end,
            lambda start_ns: edge_of(make(start_ns)),
            known,
            lambda _edge: conclude(made[-1]),
            ending,
        )
    if options.key_file is not None:
        raise SettingsError("--dialect takes no --key-file: a car's frames are not authenticated")
    from . import settings as ends
    from .gateway import Gateway, dialect_text

    spoken = dialect
    spoken.refuse_law(law)
    own, peer = (ends.PLANT, ends.CONTROLLER) if end is PLANT else (ends.CONTROLLER, ends.PLANT)
    received = spoken.sent_by(peer)
    if any(one.flags & FD for one in spoken.messages):
        options.fd = True
    has_extended = any(one.flags & EXTENDED for one in received)
    can_ids = None if has_extended else {*spoken.kept_ids, *(one.can_id for one in received)}

    def conclude_gateway(edge: ReportingNode) -> None:
        say(name, f"dialect: {dialect_text(edge.report()['dialect'])}")
        conclude(made[-1])

    return run_node(
        name,
        options,
        settings,
        lambda start_ns: edge_of(Gateway(make(start_ns), spoken, own, start_ns)),
        conclude_gateway,
        can_ids,
        f"speaks {options.dialect.name}; frames of a car are not authenticated",
        ending,
    )
