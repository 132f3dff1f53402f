"""The two ends of a bus, one for each node of the pair."""

from enum import StrEnum


class End(StrEnum):
    """One end; the node at the other end is its peer."""

    PLANT = "plant"
    CONTROLLER = "controller"

    @property
    def peer(self) -> "End":
        """The other end."""
        return End.PLANT if self is End.CONTROLLER else End.CONTROLLER
