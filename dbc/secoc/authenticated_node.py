"""A node behind authentication: it receives only authentic frames, and all it sends is secured.

    bus ── secured ──► verify ── classic ──► node ── classic ──► secure ── secured ──► bus

The inner node is the one that runs on classic CAN and does not know of authentication: the same
frames in give the same frames out. Refused frames do not reach it. They are counted here by cause,
and the node is notified of each, so that it can report the refusal on the bus.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ...runtime.frame import Frame
from ...runtime.node import N, View, Wrapper
from ..messages import CAN_IDS
from .authentication import Authentication
from .secured_frame import Refused

_OUR_IDS = frozenset(CAN_IDS.values())


def other_keys_text(peers: Sequence[str]) -> str:
    """Return what to tell of peers that seem to have another key; empty for none."""
    names = " and ".join(f"the {peer.lower().replace('_', ' ')}" for peer in peers)
    return names and f"frames of {names} fail authentication: another key (--key-file)?"


class AuthenticatedNode(Wrapper[N]):
    """Runs ``node`` as one end of an authenticated connection."""

    def __init__(self, node: N, authentication: Authentication) -> None:
        super().__init__(node)
        self._authentication = authentication
        self._verified = 0
        self._refused = Counter[str]()

    @property
    def refused(self) -> Mapping[str, int]:
        """Frames under our identifiers that did not reach the node, by cause."""
        return dict(sorted(self._refused.items()))

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node if it is authentic and new."""
        if frame.can_id not in _OUR_IDS:  # ignored, as without authentication
            return ()
        verified = self._authentication.verify(frame)
        if isinstance(verified, Refused):
            self._refused[verified.value] += 1
            self.node.on_unauthenticated()
            return ()
        self._verified += 1
        return self._secured(self.node.on_frame(verified, now_ns))

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Run the node's due tasks, and secure the frames it sends."""
        return self._secured(self.node.on_tick(now_ns))

    def view(self, now_ns: int) -> View:
        """Return the node's view, with the frames that authentication refused."""
        view = self.node.view(now_ns)
        refused = {
            f"frames refused by authentication, {why}": n for why, n in self._refused.items()
        }
        states = {
            **view.states,
            "another key": other_keys_text(self._authentication.peers_with_another_key),
        }
        return view._replace(states=states, counts={**view.counts, **refused})

    def report(self) -> Mapping[str, Any]:
        """Return the node's report, with the figures of authentication under ``authentication``.

        ``synchronised``  whether every peer has answered this end's challenge
        ``verified``      frames that were authentic and new
        ``refused``       the others, by cause; the node's ``rejected`` does not contain them
        ``other_keys``    peers that seem to have another key
        """
        return {
            **self.node.report(),
            "authentication": {
                "synchronised": self._authentication.is_synchronised,
                "verified": self._verified,
                "refused": self.refused,
                "other_keys": self._authentication.peers_with_another_key,
            },
        }

    def _secured(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        return [self._authentication.secure(frame) for frame in frames]
