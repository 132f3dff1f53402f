"""Which messages faults act on and settings name: ours, or those of the car whose dialect is on."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .messages_on_bus import OURS, MessagesOnBus
from .settings import NAMES

if TYPE_CHECKING:
    from ...dbc.dialect.dialect import Dialect


def messages_on(dialect: "Dialect | None") -> MessagesOnBus:
    """Return the messages on a bus; without a dialect they are ours."""
    if dialect is None:
        return OURS
    from .messages_of_car import MessagesOfCar  # needs cantools, which takes a while to import

    return MessagesOfCar(dialect)


def naming(dialect: "Dialect | None") -> Mapping[str, Any]:
    """Return the context in which settings of a plant on this bus are validated."""
    return {NAMES: messages_on(dialect).names}
