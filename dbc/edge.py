"""The edge between a node and its bus: plain, authenticated (``--key-file``) or of a car.

The key itself is never an option, because every user of a machine can read command lines.
"""

import argparse
import sys
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..runtime.command_line import say
from ..runtime.frame import EXTENDED, FD
from ..runtime.node.end import End
from ..runtime.program.report import causes_line
from ..runtime.program.run_node import Edge
from ..runtime.settings import SettingsError
from .bus_language import BusLanguage, add_dialect_argument, read_language
from .messages import CAN_IDS, Message, sent_by
from .secoc.authenticated_node import AuthenticatedNode, other_keys_text
from .secoc.key_file import open_authentication
from .secoc.secured_frame import STATUS_SENT_BY, Refused

if TYPE_CHECKING:
    from .dialect.dialect import Dialect

UNAUTHENTICATED = (
    "classic CAN does not authenticate senders: anyone on the bus can steer (see --key-file)"
)
"""Printed on start by a program without a key."""
AUTHENTICATED = "authenticated CAN FD: only frames made with the key are accepted"


def add_edge_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--dialect`` and ``--key-file``."""
    add_dialect_argument(parser)
    parser.add_argument(
        "--key-file", type=Path, metavar="FILE",
        help="authenticate every frame, as CAN FD, with this key",
    )  # fmt: skip


def read_edge_options(options: argparse.Namespace) -> BusLanguage:
    """Return the language of ``--dialect``; raises SettingsError, also with ``--key-file``.

    Each program that takes both calls it first.
    """
    if options.dialect is not None and options.key_file is not None:
        raise SettingsError("--dialect takes no --key-file: a car's frames are not authenticated")
    return read_language(options.dialect)


def takes_fd(options: argparse.Namespace) -> bool:
    """Return whether the bus is to carry CAN FD: by ``--fd``, and with a key."""
    return bool(getattr(options, "fd", False) or options.key_file)


def open_edge(
    end: End | None,
    known: Collection[type[Message]],
    options: argparse.Namespace,
    language: BusLanguage,
) -> Edge:
    """Return the edge that the options ask for; sets ``options.fd`` where its frames need that.

    ``end``    None for a hand wheel
    ``known``  the messages that the node receives, and those that only it may send

    Raises SettingsError for a key file that cannot be used.
    """
    if language.car is not None:
        return _of_car(end, options, language.car)
    can_ids = {CAN_IDS[message_type] for message_type in known}
    if options.key_file is None:
        return Edge(can_ids, UNAUTHENTICATED, say_figures=_say_refused)
    own = "HAND_WHEEL" if end is None else end.name
    peers = [
        name for name in STATUS_SENT_BY if name != own and not {*known}.isdisjoint(sent_by(name))
    ]
    authentication = open_authentication(options.key_file, peers)
    options.fd = True
    can_ids |= {CAN_IDS[STATUS_SENT_BY[name]] for name in peers}
    secured = partial(AuthenticatedNode, authentication=authentication)
    return Edge(can_ids, AUTHENTICATED, secured, _say_refused)


def _of_car(end: End | None, options: argparse.Namespace, car: "Dialect") -> Edge:
    received = car.sent_by(end.peer if end else End.PLANT)
    sent = car.sent_by(end) if end else []
    if any(one.flags & FD for one in car.messages):
        options.fd = True
    has_extended = any(one.flags & EXTENDED for one in (*received, *sent))
    can_ids = {*car.kept_ids, *(one.can_id for one in (*received, *sent))}
    notice = f"speaks {options.dialect.name}; frames of a car are not authenticated"
    if uncounted := [one.name for one in received if one.carries and not one.settings.counter]:
        names = ", ".join(uncounted)
        notice += f"; a second sender is not noticed of what has no counter: {names}"
    return Edge(None if has_extended else can_ids, notice, say_figures=_say_translated)


def _say_refused(name: str, report: Mapping[str, Any]) -> None:
    if secured := report["rejected"].get(Refused.NO_KEY.value):
        why = "their sender has a key, this end has none"
        say(name, f"frames refused: {secured}, as {why} (--key-file)", sys.stderr)
    authentication = report.get("authentication", {"refused": {}, "other_keys": ()})
    if refused := authentication["refused"]:
        say(name, f"frames refused by authentication: {causes_line(refused)}", sys.stderr)
    if text := other_keys_text(authentication["other_keys"]):
        say(name, text, sys.stderr)


def _say_translated(name: str, report: Mapping[str, Any]) -> None:
    say(name, f"dialect: {translated_text(report['dialect'])}")


def translated_text(figures: Mapping[str, Any]) -> str:
    """Return the figures of a gateway to a car's bus in words."""
    causes = ", ".join(f"{count} {why}" for why, count in figures["refused"].items()) or "none"
    return f"{figures['sent']} frames sent, {figures['accepted']} accepted, refused: {causes}"
