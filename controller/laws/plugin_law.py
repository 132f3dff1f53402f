"""A law from another package: found by its name, and guarded so that it cannot end the controller.

It is named ``package.module:ATTRIBUTE``, or by an entry point of the group ``steer_by_wire.laws``.
An exception while it runs counts as an output that is not finite: the controller holds the last
command, restarts the law once, and stops safely if it fails again.
"""

from collections.abc import Callable
from functools import cache
from math import isfinite, nan
from typing import Any

from ...dbc.messages import LawNumber
from ...runtime.settings.plugin import cause, find_part
from ..law_interface import Law, LawInput, LawOutput

GROUP = "steer_by_wire.laws"
"""Entry points of this group name laws."""

_NO_NUMBER = LawOutput(nan, nan, nan, nan)


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


class Guard:
    """A law's functions with all exceptions caught; ``mistake`` describes the last one."""

    def __init__(self, law: Law) -> None:
        self._law = law
        self.mistake = ""

    def step(self, params: Any, state: Any, observed: LawInput) -> tuple[Any, LawOutput]:
        """Advance the law by one period; an invalid output is replaced by one without numbers."""
        if state is None or params is None:
            return state, _NO_NUMBER
        try:
            after, output = self._law.step(params, state, observed)
            return after, numbers_or_none(LawOutput(*output))
        except Exception as error:
            self._note(error)
            return state, _NO_NUMBER

    def plan(self, params: Any, state: Any, observed: LawInput) -> int:
        """Write the law's plan; without one, -1, if it raises."""
        try:
            return -1 if self._law.plan is None else self._law.plan(params, state, observed)
        except Exception as error:
            self._note(error)
            return -1

    def params_at(self, at: Callable[[float], Any], speed_m_s: float) -> Any:
        """Return the law's params at a speed; None, on which every step fails, if it raises."""
        return self._unless_raised(at, speed_m_s)

    def at_rest(self, params: Any, lateral_error_m: float) -> Any:
        """Return the law's state at rest; None, on which every step fails, if it raises."""
        return self._unless_raised(self._law.at_rest, params, lateral_error_m)

    def after_hold(self, params: Any, state: Any, lateral_error_m: float) -> Any:
        """Return the law's state after a hold; None if it raises."""
        if self._law.after_hold is None:
            return self.at_rest(params, lateral_error_m)
        return self._unless_raised(self._law.after_hold, params, state, lateral_error_m)

    def _unless_raised(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            self._note(error)
            return None

    def _note(self, error: Exception) -> None:
        self.mistake = cause(error)


def numbers_or_none(output: LawOutput) -> LawOutput:
    """Return the output, or one without any numbers if a field is not finite."""
    if (
        isfinite(output.steer_rad)
        and isfinite(output.disturbance_rad)
        and isfinite(output.network_disturbance_rad)
        and isfinite(output.compensated_lateral_error_m)
    ):
        return output
    return LawOutput(nan, nan, nan, nan)
