"""The language of a bus: our own messages, or those of a car (``--dialect``).

Everyone who runs a node or listens holds a ``BusLanguage`` and need not know which of the two it
is. Only a car's reads a database.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..runtime.node import ReportingNode
from ..runtime.node.end import End
from .listening import OUR_MESSAGES, Listening

if TYPE_CHECKING:
    from .dialect.dialect import Dialect


def add_dialect_argument(
    parser: argparse.ArgumentParser, what: str = "speak the messages of a car on the bus"
) -> None:
    """Add ``--dialect``."""
    parser.add_argument("--dialect", type=Path, metavar="CAR.toml", help=what)


class BusLanguage(NamedTuple):
    """What is spoken on a bus.

    ``file``  of a car's dialect; None: our own messages
    ``car``   the dialect in it
    """

    file: Path | None = None
    car: "Dialect | None" = None

    @property
    def options(self) -> list[str]:
        """The words with which a program is told to speak it."""
        return [] if self.file is None else ["--dialect", str(self.file)]

    @property
    def files(self) -> tuple[Path, ...]:
        """The file of a car, and its database."""
        return () if self.car is None or self.file is None else (self.file, self.car.database)

    @property
    def missing(self) -> frozenset[str]:
        """Names of the measured quantities that no message of the car carries."""
        return frozenset() if self.car is None else self.car.missing

    def at_edge(self, node: ReportingNode, end: End | None, start_ns: int) -> ReportingNode:
        """Return a node as it is on the bus, ``end`` None: a hand wheel; a car's has a gateway."""
        if self.car is None:
            return node
        from .dialect.gateway import Gateway

        return Gateway(node, self.car, end, start_ns)

    def listening(self) -> Listening:
        """Return a passive listener."""
        if self.car is None:
            return OUR_MESSAGES
        from .dialect.reader import listening_to

        return listening_to(self.car)

    def refuse_law(self, law: str) -> None:
        """Raise SettingsError if no signal of the car carries what a law reads.

        ``law``  as ``law_that_reads_the_vehicle``; an empty one is content
        """
        if self.car is not None:
            self.car.refuse_law(law)


OUR_LANGUAGE = BusLanguage()


def read_language(file: Path | str | None) -> BusLanguage:
    """Return the language of a car's file; without one, ours.

    Raises SettingsError with a line for each mistake in the file.
    """
    if not file:
        return OUR_LANGUAGE
    from .dialect.dialect import read_dialect

    return BusLanguage(Path(file), read_dialect(Path(file)))
