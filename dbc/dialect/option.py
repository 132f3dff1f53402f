"""The option ``--dialect`` of the programs; without it nothing here reads a database."""

import argparse
from collections.abc import Callable, Collection
from pathlib import Path

from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.frame import EXTENDED, FD
from ...runtime.node import N
from ...runtime.program.fail_if_conditions import Ending
from ...runtime.program.run_node import run_node
from ...runtime.settings import Settings, SettingsError
from ..messages import Message
from ..secoc.key_option import run_secured_node
from ..secoc.secured_frame import PLANT, End
from .listening import OURS, Listening


def add_dialect_argument(
    parser: argparse.ArgumentParser, what: str = "speak the messages of a car on the bus"
) -> None:
    """Add ``--dialect``."""
    parser.add_argument("--dialect", type=Path, metavar="CAR.toml", help=what)


def listening_in(dialect: Path | None) -> Listening:
    """Return how one who only listens understands a bus; without a dialect it speaks our own."""
    if dialect is None:
        return OURS
    from .dialect import read_dialect
    from .overheard import Overheard

    return Overheard(read_dialect(dialect))


def run_node_in_dialect(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    end: End,
    make_node: Callable[[int], N],
    known: Collection[type[Message]],
    conclude: Callable[[N], None],
    ending: Ending,
    law: str = "",
) -> ExitStatus:
    """Run a node as ``run_secured_node`` does, behind a gateway if a dialect is given.

    ``law``  of a controller that reads VEHICLE_STATE; empty for one that does not
    """
    if options.dialect is None:
        return run_secured_node(name, options, settings, end, make_node, known, conclude, ending)
    if options.key_file is not None:
        raise SettingsError("--dialect takes no --key-file: a car's frames are not authenticated")
    from . import settings as ends
    from .dialect import read_dialect
    from .gateway import Gateway, dialect_text

    dialect = read_dialect(options.dialect)
    dialect.refuse_law(law)
    own, peer = (ends.PLANT, ends.CONTROLLER) if end is PLANT else (ends.CONTROLLER, ends.PLANT)
    received = dialect.sent_by(peer)
    if any(one.flags & FD for one in dialect.messages):
        options.fd = True
    has_extended = any(one.flags & EXTENDED for one in received)
    can_ids = None if has_extended else {*dialect.kept_ids, *(one.can_id for one in received)}

    def make_gateway(start_ns: int) -> Gateway[N]:
        return Gateway(make_node(start_ns), dialect, own, start_ns)

    def conclude_gateway(node: Gateway[N]) -> None:
        say(name, f"dialect: {dialect_text(node.report()['dialect'])}")
        conclude(node.node)

    notice = f"speaks {options.dialect.name}; frames of a car are not authenticated"
    return run_node(
        name, options, settings, make_gateway, conclude_gateway, can_ids, notice, ending
    )
