"""What happens on a channel beside its clients' frames."""

from collections.abc import Sequence
from typing import NamedTuple

from ..bus_model.rest_bus import PeriodicMessage
from ..bus_model.settings import BusSettings


class Beside(NamedTuple):
    """Other people's ``messages``, and errors as the settings say, both drawn from the seed."""

    settings: BusSettings = BusSettings()
    messages: Sequence[PeriodicMessage] = ()
    seed: int = 1


NOTHING_BESIDE = Beside()


def client_number(name: str) -> int:
    """Return the number of a client from its name in settings; raises ValueError."""
    if not (name.isascii() and name.isdecimal()):
        raise ValueError("is not the number of a client, as the broker prints it: 1, 2, ...")
    return int(name)
