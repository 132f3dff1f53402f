"""The option ``--key-file`` of both programs; without it nothing here needs cryptography.

The key itself is never an option, because every user of a machine can read command lines.
"""

import argparse
import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.node import N
from ...runtime.program.fail_if_conditions import Ending
from ...runtime.program.report import causes_line
from ...runtime.program.run_node import run_node
from ...runtime.recording.recording import fd_obstacle
from ...runtime.settings import Settings, SettingsError
from ..messages import CAN_IDS, Message
from .secured_frame import End, Refused

NOBODY = "classic CAN authenticates nobody: anybody on the bus can steer (see --key-file)"
"""Printed on start by a program without a key."""
AUTHENTICATED = "authenticated CAN FD: only frames made with the key are accepted"


def add_key_file_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--key-file``."""
    parser.add_argument(
        "--key-file",
        type=Path,
        metavar="FILE",
        help="authenticate every frame, as CAN FD, with this key",
    )


def run_secured_node(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    end: End,
    make_node: Callable[[int], N],
    known: Collection[type[Message]],
    conclude: Callable[[N], None],
    ending: Ending,
) -> ExitStatus:
    """Run a node as ``runtime.program.run_node`` does, behind authentication if a key is given.

    ``end``    which of the two ends the node is
    ``known``  the messages it receives, and those that nobody else may send

    Reports on standard error whose frames are accepted, and at the end the refused ones and the
    messages that somebody else has sent too. Raises SettingsError for a key file that cannot be
    used and a recording that would stay empty, and the exceptions of ``run_node``.
    """
    can_ids = {CAN_IDS[message_type] for message_type in known}
    if options.key_file is None:

        def conclude_classic(node: N) -> None:
            _say_refused(name, node.report())
            conclude(node)

        return run_node(
            name, options, settings, make_node, conclude_classic, can_ids, NOBODY, ending
        )
    if options.record is not None and (obstacle := fd_obstacle(options.record)):
        raise SettingsError(f"{obstacle}; with --key-file all frames are CAN FD")
    # Not at the top: they read the DBC once more, which classic CAN does not need.
    from .authenticated_node import AuthenticatedNode
    from .key_file import open_authentication

    authentication = open_authentication(options.key_file, end)
    options.fd = True

    def make_secured(start_ns: int) -> AuthenticatedNode[N]:
        return AuthenticatedNode(make_node(start_ns), authentication)

    def conclude_secured(node: AuthenticatedNode[N]) -> None:
        _say_refused(name, node.report())
        conclude(node.node)

    can_ids.add(CAN_IDS[end.peer_status])
    return run_node(
        name, options, settings, make_secured, conclude_secured, can_ids, AUTHENTICATED, ending
    )


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
