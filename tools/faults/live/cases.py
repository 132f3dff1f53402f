"""The faults of the live campaign, ``cases.toml``, and which program must detect each of them."""

from collections.abc import Mapping
from functools import cache

from ....closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from ....plant_emulator.faults.settings import FaultSettings
from ....runtime.settings import Settings, load_settings, read_preset
from ..injection.live_faults import LiveKind

ONSET_S, DURATION_S = 0.5, 1.0
PLANT_ONSET_S = 2.0
"""Onset of faults in the plant's settings, after the first command, sent as the run starts."""
SILENCE, LOST, SKIPPED, LIMITED = "silence", "lost", "skipped", "intervention"
"""Counters of a node: that it held because nothing arrived, missed frames, missed periods of its
own, or had to limit a command."""


class LiveCase(Settings):
    """One run; its keys are explained in ``cases.toml``."""

    inject: str = ""
    targets: tuple[str, ...] = ()
    at_plant: FaultSettings | None = None
    plant: tuple[str, ...] = ()
    controller: tuple[str, ...] = ()
    with_key: bool = False
    reconnects: bool = False
    ends: Mapping[str, int] = {}
    name: str = ""

    @property
    def argument(self) -> str:
        """The fault to inject, with its times."""
        times = f"onset_s={ONSET_S:g}"
        if not self.inject.startswith((LiveKind.KILL, LiveKind.CLOCK_JUMP)):
            times += f",duration_s={DURATION_S:g}"
        kind, comma, rest = self.inject.partition(",")
        return f"{kind},{times}{comma}{rest}"

    @property
    def expected(self) -> Mapping[str, tuple[str, ...]]:
        """The counters of which one must have risen, by program."""
        both = {PLANT_PROGRAM: self.plant, CONTROLLER_PROGRAM: self.controller}
        return {name: counters for name, counters in both.items() if counters}


class _LiveCases(Settings):
    groups: Mapping[str, tuple[str, ...]]
    cases: Mapping[str, LiveCase]


@cache
def live_cases() -> tuple[LiveCase, ...]:
    """Return the cases in their order."""
    file = load_settings(_LiveCases, read_preset(__package__, "cases"))

    def counters(names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(one for name in names for one in file.groups.get(name, (name,)))

    return tuple(
        case.model_copy(
            update={
                "name": name,
                "plant": counters(case.plant),
                "controller": counters(case.controller),
            }
        )
        for name, case in file.cases.items()
    )
