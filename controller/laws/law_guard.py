"""Guard around a law from another package, whose exceptions cannot end the controller.

An exception while the law runs counts as an output that is not finite: the controller holds the
last command, restarts the law once, and stops safely if it fails again.
"""

from collections.abc import Callable
from functools import partial
from math import isfinite, nan
from typing import Any

from ...runtime.settings.plugin import cause
from ..law_interface import Law, LawInput, LawOutput, LawStep

_NO_NUMBER = LawOutput(nan, nan, nan, nan)


class Guard:
    """Catches all exceptions of a law; ``mistake`` describes the last one."""

    def __init__(self) -> None:
        self.mistake = ""

    def around(self, law: Law) -> Law:
        """Return the law with its functions guarded. On a state of None every step fails."""
        return law._replace(
            step=partial(self._step, law.step),
            at_rest=self.called(law.at_rest),
            after_hold=None if law.after_hold is None else self.called(law.after_hold),
            plan=None if law.plan is None else self.called(law.plan, otherwise=-1),
            believes=None,
        )

    def called(self, function: Callable[..., Any], otherwise: Any = None) -> Callable[..., Any]:
        """Return a function that returns ``otherwise`` where this one raises."""

        def guarded(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:
                self.mistake = cause(error)
                return otherwise

        return guarded

    def _step(
        self, step: LawStep, params: Any, state: Any, observed: LawInput
    ) -> tuple[Any, LawOutput]:
        if state is None or params is None:
            return state, _NO_NUMBER
        try:
            after, output = step(params, state, observed)
            return after, numbers_or_none(LawOutput(*output))
        except Exception as error:
            self.mistake = cause(error)
            return state, _NO_NUMBER


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
