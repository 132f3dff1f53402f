"""The control laws: one module each, named as the law in the DBC, and found by that name.

Not here: who runs a law (``node.law_runner``). Begin with ``pd``; ``law_from_settings`` wraps
additions around a law. A law from another package is named ``package.module:ATTRIBUTE``.
"""

from collections.abc import Mapping
from importlib import import_module

from ...dbc.messages import LawNumber
from ..law_interface import Law, LawInput, LawOutput, last_command

__all__ = ["LAWS", "PAPER_LAWS", "Law", "LawInput", "LawOutput", "last_command"]

PAPER_LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob")
"""Those of SAE 2018-01-1086."""


def _shipped_laws() -> Mapping[str, Law]:
    names = [number.name.lower() for number in LawNumber if number is not LawNumber.CUSTOM]
    return {name: import_module(f"{__name__}.{name}").LAW for name in names}


LAWS: Mapping[str, Law] = _shipped_laws()
"""By the names of settings files."""
