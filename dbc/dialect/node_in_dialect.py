"""A node on a bus that may speak a car's messages; without a dialect nothing reads a database."""

from typing import TYPE_CHECKING

from ...runtime.node import ReportingNode
from ...runtime.node.end import End

if TYPE_CHECKING:
    from .dialect import Dialect


def in_dialect(
    node: ReportingNode,
    dialect: "Dialect | None",
    end: End,
    start_ns: int,
) -> ReportingNode:
    """Return a node behind a gateway, if the bus speaks a car's messages."""
    if dialect is None:
        return node
    from .gateway import Gateway

    return Gateway(node, dialect, end, start_ns)
