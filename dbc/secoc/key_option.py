"""The option ``--key-file`` of both programs; without it nothing here needs cryptography.

The key itself is never an option, because every user of a machine can read command lines.
"""

import argparse
import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.node import ReportingNode, innermost
from ...runtime.node.end import End
from ...runtime.program.fail_if_conditions import Ending
from ...runtime.program.report import causes_line
from ...runtime.program.run_node import run_node
from ...runtime.recording.recording import fd_obstacle
from ...runtime.settings import Settings, SettingsError
from ..messages import CAN_IDS, Message
from .secured_frame import STATUS_SENT_BY, Refused

NOBODY = "classic CAN authenticates nobody: anybody on the bus can steer (see --key-file)"
"""Printed on start by a program without a key."""
AUTHENTICATED = "authenticated CAN FD: only frames made with the key are accepted"


class Program(NamedTuple):
    """What all runs of a program have in common.

    ``end``    which of the two ends its node is
    ``known``  the messages it receives, and those that nobody else may send
    """

    name: str
    end: End
    known: Collection[type[Message]]
    ending: Ending


def add_key_file_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--key-file``."""
    parser.add_argument(
        "--key-file", type=Path, metavar="FILE",
        help="authenticate every frame, as CAN FD, with this key",
    )  # fmt: skip


def run_secured_node(
    program: Program,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], ReportingNode],
    conclude: Callable[[Any], None],
) -> ExitStatus:
    """Run a node as ``runtime.program.run_node`` does, behind authentication if a key is given.

    ``make_node``  returns the node with what stands between it and the bus
    ``conclude``   gets the node itself

    Reports on standard error whose frames are accepted, and at the end the refused ones and the
    messages that somebody else has sent too. Raises SettingsError for a key file that cannot be
    used and a recording that would stay empty, and the exceptions of ``run_node``.
    """
    can_ids = {CAN_IDS[message_type] for message_type in program.known}

    def conclude_checked(node: ReportingNode) -> None:
        _say_refused(program.name, node.report())
        conclude(innermost(node))

    if options.key_file is None:
        run = program.name, options, settings, make_node, conclude_checked
        return run_node(*run, can_ids, NOBODY, program.ending)
    if options.record is not None and (obstacle := fd_obstacle(options.record)):
        raise SettingsError(f"{obstacle}; with --key-file all frames are CAN FD")
    # Not at the top: they read the DBC once more, which classic CAN does not need.
    from .authenticated_node import AuthenticatedNode
    from .key_file import open_authentication

    authentication = open_authentication(options.key_file, program.end)
    options.fd = True

    def make_secured(start_ns: int) -> ReportingNode:
        return AuthenticatedNode(make_node(start_ns), authentication)

    can_ids.add(CAN_IDS[STATUS_SENT_BY[program.end.peer]])
    secured = program.name, options, settings, make_secured, conclude_checked
    return run_node(*secured, can_ids, AUTHENTICATED, program.ending)


def _say_refused(name: str, report: Mapping[str, Any]) -> None:
    """Name refused frames, and messages that had two senders during the run."""
    if secured := report["rejected"].get(Refused.NO_KEY.value):
        why = "their sender has a key, this end has none"
        say(name, f"frames refused: {secured}, as {why} (--key-file)", sys.stderr)
    if refused := report.get("authentication", {}).get("refused"):
        say(name, f"frames refused by authentication: {causes_line(refused)}", sys.stderr)
    if messages := report["second_senders"]:
        what = "two nodes on the bus send what only one may"
        say(name, f"second sender of {', '.join(messages)}: {what}", sys.stderr)
