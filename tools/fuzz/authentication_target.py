"""Random traffic to a node behind authentication, from a peer with the key and from one without.

No exception escapes; every frame under an identifier of the contract is counted once.
Only what the peer has secured reaches the node, unchanged, and once: no frame that was changed by a
bit, was forged, or is a repetition.
All frames that leave are secured.
"""

import hashlib

from ...controller.node import ControllerNode
from ...dbc.authenticated_node import AuthenticatedNode
from ...dbc.authentication import Authentication
from ...dbc.messages import CAN_IDS, LateralError, PlantStatus, SteeringStatus, VehicleState
from ...dbc.secured_frame import CONTROLLER, PLANT, is_secured
from ...runtime.frame import Frame
from .choices import Choices
from .node_targets import controller_settings
from .promises import promise
from .traffic import DATA_IDS, Sender, wake_ups

_OF_PLANT = {CAN_IDS[kind] for kind in (LateralError, SteeringStatus, VehicleState, PlantStatus)}
_OUR_IDS = frozenset(CAN_IDS.values())
_KEPT = 50
"""Frames on the wire that an attacker remembers."""


def fuzz_authentication(data: bytes) -> None:
    """Let a peer and an attacker send to a controller."""
    choices = Choices(data)
    peer = Authentication(PLANT, _mac, b"plant678", 0)
    node = AuthenticatedNode(
        ControllerNode(controller_settings(0), 0), Authentication(CONTROLLER, _mac, b"control8", 0)
    )
    received: list[Frame] = []
    ours = 0
    for now_ns, frames in wake_ups(choices, 0):
        for frame in frames:
            sent, is_genuine = _on_the_wire(choices, peer, frame, received)
            before = node.report()["authentication"]["verified"]
            answers = node.on_frame(sent, now_ns)
            verified = node.report()["authentication"]["verified"] - before
            promise(not answers, "it answers at once")
            promise(is_genuine or not verified, f"believed, but not genuine: {sent}")
            ours += sent.can_id in _OUR_IDS
        if node.deadline_ns <= now_ns:
            for frame in node.on_tick(now_ns):
                promise(is_secured(frame), f"leaves unsecured: {frame}")
                if choices.chance(200):  # or the network loses it
                    peer.verify(frame)
    report = node.report()
    counted = report["authentication"]
    total = counted["verified"] + sum(counted["refused"].values())
    promise(total == ours, f"{ours} frames came, {total} were counted: {counted}")


def _on_the_wire(
    choices: Choices, peer: Authentication, frame: Frame, received: list[Frame]
) -> tuple[Frame, bool]:
    """Return what arrives instead of ``frame``, and whether it is the peer's own and new."""
    kind = choices.integer(0, 7)
    if kind < 4 and frame.can_id in _OF_PLANT and not frame.flags and len(frame.data) == 8:
        secured = peer.secure(frame)
        received[_KEPT:] = []
        received.insert(0, secured)
        return secured, True
    if kind < 6 and received:
        old = choices.pick(received)
        if kind == 4:
            return old, False
        place = choices.integer(0, 8 * len(old.data) - 1)
        changed = bytearray(old.data)
        changed[place // 8] ^= 1 << place % 8
        return old._replace(data=bytes(changed)), False
    if kind == 6:
        size = choices.pick((8, 12, 24, 48, 64))
        can_id = choices.pick([CAN_IDS[message_type] for message_type in DATA_IDS])
        return Frame(can_id, choices.raw(size), choices.integer(0, 31)), False
    return (frame if choices.chance(128) else Sender().frame(choices)), False


def _mac(text: bytes) -> bytes:
    """Stand for the CMAC: 16 bytes that nobody else can compute."""
    return hashlib.blake2b(text, digest_size=16, key=b"of this test").digest()
