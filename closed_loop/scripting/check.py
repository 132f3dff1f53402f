"""The analysis of a controller's loop from Python: what ``steer-by-wire check`` prints, as figures.

>>> import steer_by_wire
>>> checked = steer_by_wire.check("practical_pd")
>>> f"{checked.verdict}, {1e3 * checked.delay_margin_s:.2f} ms"
'stable, 577.24 ms'
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...controller.analysis.check_figures import check_figures, loop_response
from ...controller.analysis.check_verdict import CheckVerdict, found_in
from ...controller.analysis.sampled_loop import StabilityMargins
from ...controller.law_interface import Law
from ...controller.settings import ControllerSettings
from ...runtime.array_types import ComplexArray, FloatArray
from .simulate import NO_OVERRIDES, settings_of


class Check(NamedTuple):
    """The verdict on a loop, and the figures behind it.

    ``delay_margin_s``  constant delay at which stability is first lost, infinite beyond the search;
                        None where there is no analysis
    ``analysis``        all figures, as ``steer-by-wire check --json`` writes them
    """

    verdict: CheckVerdict
    delay_margin_s: float | None
    reason: str
    settings: ControllerSettings
    analysis: Mapping[str, Any]

    def __repr__(self) -> str:
        """Return the verdict in one line."""
        return f"<Check of {self.settings.law}: {self.verdict}: {self.reason}>"

    @property
    def stable_delays_s(self) -> list[tuple[float, float]]:
        """Stretches of constant delays at which the loop is stable [s]; none without analysis."""
        delays = self.analysis.get("stable_delays", {"intervals_s": []})
        return [(first_s, last_s) for first_s, last_s in delays["intervals_s"]]

    def loop_response(self, omega_rad_s: FloatArray, delay_s: float = 0.0) -> ComplexArray:
        """Return the open loop L(jω) around the nominal plant, shape of ``omega_rad_s``.

        ``omega_rad_s``  above 0, up to π over the control period
        ``delay_s``      constant delay from command to measurement

        -1 is the critical point, so ``control.frd(checked.loop_response(omega), omega)`` of
        python-control draws it.

        Raises ValueError for an ω or a delay out of range, and for a law that looks back.
        """
        return loop_response(self.settings, np.asarray(omega_rad_s, dtype=np.float64), delay_s)

    @property
    def margins(self) -> StabilityMargins | None:
        """The margins without delay; None where not stable, or where the law looks back."""
        margins = self.analysis.get("margins")
        return None if margins is None else StabilityMargins(**margins)


def check(
    controller: str | Path | ControllerSettings = "practical_pd_ddob",
    *,
    vehicle: str | Path | None = None,
    law: str | Law | None = None,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
) -> Check:
    """Return the stability of the loop around the nominal plant and the corners of [validity].

    Arguments are as for ``simulate``; overrides are named ``table.key``. Raises SettingsError.
    """
    values = {**overrides, **({} if law is None else {"law": law})}
    settings = settings_of(ControllerSettings, controller, values, vehicle)
    figures = check_figures(settings, lambda _what: None)
    return Check(*found_in(figures), settings, figures)
