"""Every figure and table that can be computed: how it is selected, and what computes it.

Modules are imported when their figure is requested, so that one figure does not load all of them.
"""

from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple

from .result import Reproduction


class Entry(NamedTuple):
    """One figure or table.

    ``key``                 as in its Reproduction, and the stem of its files
    ``kind``, ``number``    what selects it: --figure 8, --table 2
    ``module``, ``name``    of the function without arguments that computes it, in this folder
    """

    key: str
    kind: str
    number: str
    module: str
    name: str


def _figure(number: int, module: str, suffix: str = "") -> Entry:
    name = f"figure_{number}{suffix}"
    return Entry(f"figure_{number:02d}{suffix}", "figure", str(number), module, name)


ENTRIES = (
    _figure(2, "uncertainty_figure"),
    _figure(7, "parameter_space_figures"),
    _figure(8, "parameter_space_figures"),
    _figure(8, "parameter_space_figures", "_beyond"),
    _figure(9, "uncertainty_figure"),
    _figure(10, "frequency_figures"),
    _figure(11, "frequency_figures"),
    _figure(12, "network_figure"),
    _figure(14, "path_figures"),
    _figure(15, "path_figures"),
    *(_figure(number, "dob_figures") for number in range(16, 21)),
    Entry("table_2", "table", "2", "table_2", "table_2"),
    *(_figure(number, "delay_figures") for number in range(21, 25)),
    _figure(21, "varying_delay_figure", "_varying"),
    Entry("robustness_table", "table", "robustness", "robustness_table", "robustness_table"),
)
"""In the order of the paper, which is the order of the index page."""

NOT_COMPUTED = {
    "figure": {
        "1": "a sketch of the vehicle",
        **dict.fromkeys(("3", "4", "5", "6", "13"), "a block diagram"),
    },
    "table": {"1": "the vehicle's parameters, an input"},
}
"""Figures and tables of the paper in which there is nothing to compute."""


def numbers_of(kind: str) -> tuple[str, ...]:
    """Return the numbers that ``--figure`` or ``--table`` takes, each once."""
    return tuple(dict.fromkeys(entry.number for entry in ENTRIES if entry.kind == kind))


def entry_of(key: str) -> Entry:
    """Return the entry with a key; raises KeyError where there is none."""
    return {entry.key: entry for entry in ENTRIES}[key]


def function_of(entry: Entry) -> Callable[[], Reproduction]:
    """Import and return the function that computes an entry."""
    function: Callable[[], Reproduction] = getattr(
        import_module(f"steer_by_wire.tools.reproduce_paper.{entry.module}"), entry.name
    )
    return function
