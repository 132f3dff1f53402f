"""Compiled runs of a law from another package: laws that do not compile, and laws that raise.

Such a law is compiled anew in every process, because it is unknown what its file depends on.
"""

from functools import cache
from typing import Any

from numba.core.errors import NumbaError

from ..controller.law_record import LawStep
from ..runtime.settings import SettingsError
from .compilation import compiled_anew

_FAILED = "Failed in nopython mode pipeline"


class LawNotCompiledError(SettingsError):
    """numba cannot compile the law."""


class LawRaisedError(SettingsError):
    """The law raised an exception; the two nodes would count it as an output that is not finite."""


class OwnFunction:
    """A compiled function; its exceptions come from the law."""

    def __init__(self, law: str, function: Any) -> None:
        self._law, self._function = law, function

    def __call__(self, *arguments: Any) -> Any:
        """Run it; raises LawNotCompiledError and LawRaisedError."""
        try:
            return self._function(*arguments)
        except NumbaError as error:
            raise LawNotCompiledError(
                f"law = {self._law!r}: numba cannot compile it: {_cause(error)}; the nodes run it"
                " as it is: steer-by-wire run"
            ) from error
        except Exception as error:
            cause = f"{type(error).__name__}: {error}".splitlines()[0]
            raise LawRaisedError(f"law = {self._law!r}: it raises {cause}") from error


@cache
def own_functions(
    law: str, _step: LawStep, functions: tuple[Any, ...], fastmath: bool
) -> tuple[OwnFunction, ...]:
    """Return functions of ``compiled.loop``, compiled for a law of another package."""
    return tuple(
        OwnFunction(law, compiled_anew(function, fastmath=fastmath)) for function in functions
    )


def _cause(error: NumbaError) -> str:
    """Return the innermost reason that numba gives, and where in the law it is, in one line."""
    lines = [line.strip() for line in str(error).splitlines()]
    innermost = max((at for at, line in enumerate(lines) if _FAILED in line), default=-1) + 1
    reason, *after = lines[innermost:] or ["it does not say why"]
    place = next((line.rstrip(":") for line in after if line.startswith('File "')), None)
    return reason if place is None else f"{reason} ({place})"
