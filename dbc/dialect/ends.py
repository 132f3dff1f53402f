"""The two ends of a bus, and a node at one of them; without a dialect nothing reads a database."""

from typing import TYPE_CHECKING, Final, Literal

from ...runtime.node import ReportingNode

if TYPE_CHECKING:
    from .dialect import Dialect

PLANT: Final = "plant"
CONTROLLER: Final = "controller"


def in_dialect(
    node: ReportingNode,
    dialect: "Dialect | None",
    end: Literal["plant", "controller"],
    start_ns: int,
) -> ReportingNode:
    """Return a node behind a gateway, if the bus speaks a car's messages."""
    if dialect is None:
        return node
    from .gateway import Gateway

    return Gateway(node, dialect, end, start_ns)
