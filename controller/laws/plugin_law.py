"""Law from another package, found by its name.

It is named ``package.module:ATTRIBUTE``, or by an entry point of the group ``steer_by_wire.laws``.
"""

from functools import cache

from ...dbc.messages import LawNumber
from ...runtime.settings.plugin import find_part
from ..law_interface import Law

GROUP = "steer_by_wire.laws"
"""Entry points of this group name laws."""


class NoLawError(ValueError):
    """There is no law with this name; the text is one line."""


@cache
def place_of(name: str) -> str | None:
    """Return ``package.module:ATTRIBUTE`` if the name may be that of a law, else None."""
    if ":" in name:
        return name
    # Not at the top: it imports readers of archives and mail, which our own laws do not need.
    from importlib.metadata import entry_points

    return next((found.value for found in entry_points(group=GROUP, name=name)), None)


def find_plugin_law(name: str) -> Law:
    """Return a plug-in law, as its place is now; raises NoLawError."""
    place = place_of(name)
    if place is None:
        raise NoLawError(f"there is no law {name}")
    try:
        law = find_part(place, Law, "law")
    except ValueError as error:
        raise NoLawError(str(error)) from error
    return _as_custom(law)


@cache
def _as_custom(law: Law) -> Law:
    return law._replace(number=LawNumber.CUSTOM)
