"""What a campaign runs: cases of faults, operating points, laws, and the times of each run."""

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from typing import Annotated, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from ....controller.settings import PRESETS
from ....dbc.messages import DATA_IDS, MESSAGE_TYPES
from ....plant_emulator.faults.settings import (
    MESSAGES_OF,
    SIGNAL_FAULTS,
    FaultDirection,
    FaultKind,
    FaultSettings,
    quantities_of,
)
from ....plant_emulator.path.settings import PathSettings
from ....runtime.node.end import End
from ....runtime.settings import Settings, preset_names
from ....runtime.settings.mistakes import hint


class NodeFaultKind(StrEnum):
    """What goes wrong with a node as a whole, or with the bus."""

    KILLED = "killed"
    """As by SIGKILL: it never acts again."""
    PAUSED = "paused"
    """As by SIGSTOP and SIGCONT: frames that arrive meanwhile wait in its socket."""
    BUS_OFF = "bus_off"
    """Its bus controller is off the bus; the node still runs."""
    CLOCK_JUMP = "clock_jump"
    """Its clock jumps ahead by the magnitude [s], as on a machine that was suspended."""
    BABBLING = "babbling"
    """A further node sends the lowest identifier at full bus load."""


BUS = "bus"
"""Beside the two ends, where a fault of the bus itself is."""
SEED_MAX = 2**31


def _printable(text: str) -> str:
    if not text.isprintable():  # it is printed in tables, pages and result lines
        raise ValueError("must be printable")
    return text


def _known(law: str) -> str:
    names = preset_names(PRESETS)
    if law not in names:
        raise ValueError(f"there is no preset of this name ({hint(law, names)})")
    return law


Law = Annotated[str, AfterValidator(_known)]
"""A preset of the controller."""


class PointSettings(Settings):
    """One `[[points]]`: an operating point."""

    name: Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_printable)]
    speed_m_s: float = Field(5.0 / 3.6, ge=0.13, le=70.0)
    virtual_mass_kg: float = Field(2000.0, ge=100.0, le=100_000.0)
    downlink_ms: float = Field(0.0, ge=0.0, le=1000.0)
    uplink_ms: float = Field(0.0, ge=0.0, le=1000.0)
    jitter_ms: float = Field(0.0, ge=0.0, le=100.0)
    """Standard deviation of both latencies; frames stay in order."""
    noise_m: float = Field(0.0, ge=0.0, le=1.0)
    """Standard deviation of the noise of the lateral error."""
    path: PathSettings | None = None
    """As the plant's `[path]`; None: its ellipse, which bends as walking speed allows."""
    laws: tuple[Law, ...] = Field((), max_length=20)
    """Presets of the controller in place of the campaign's, as those for road speed."""


class CaseSettings(Settings):
    """One `[[cases]]`: a kind of fault by message and magnitude."""

    kind: FaultKind
    messages: tuple[str, ...] = Field(min_length=1, max_length=10)
    magnitudes: tuple[float, ...] = Field(min_length=1, max_length=50)
    signal: str | None = None
    """The signal that is wrong; none: the message's first quantity."""

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        known = [name for name, kind in MESSAGE_TYPES.items() if kind in DATA_IDS]
        for message in self.messages:
            if message not in known:
                raise ValueError(f"messages must be of {', '.join(known)}, not {message!r}")
            if self.kind in SIGNAL_FAULTS and not quantities_of(MESSAGE_TYPES[message]):
                raise ValueError(f"{self.kind} needs a quantity, and {message} has none")
            for magnitude in self.magnitudes:
                self._refuse_what_is_no_fault(message, magnitude)
        return self

    def _refuse_what_is_no_fault(self, message: str, magnitude: float) -> None:
        signal = self.signal_of(message) if self.kind in SIGNAL_FAULTS else self.signal
        try:
            FaultSettings(
                kind=self.kind,
                direction=direction_of(message),
                message=message,
                signal=signal,
                magnitude=magnitude,
            )
        except ValidationError as error:
            said = error.errors(include_url=False)[0]["msg"]
            raise ValueError(said.removeprefix("Value error, ")) from error

    def signal_of(self, message: str) -> str | None:
        """Return the signal that is wrong; None where the kind is not of signals."""
        if self.kind not in SIGNAL_FAULTS:
            return None
        return self.signal or quantities_of(MESSAGE_TYPES[message])[0]


class NodeCaseSettings(Settings):
    """One `[[node_cases]]`."""

    kind: NodeFaultKind
    nodes: tuple[str, ...] = Field(min_length=1, max_length=3)
    magnitudes: tuple[Annotated[float, Field(ge=0.001, le=10.0)], ...] = Field(
        (1.0,), min_length=1, max_length=50
    )

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        allowed: tuple[str, ...] = (End.CONTROLLER, End.PLANT)
        if self.kind is NodeFaultKind.BABBLING:
            allowed = (BUS,)
        elif self.kind is NodeFaultKind.CLOCK_JUMP:
            allowed = (End.CONTROLLER,)  # the plant's clock is the vehicle's
        for node in self.nodes:
            if node not in allowed:
                raise ValueError(f"nodes of {self.kind} must be {' or '.join(allowed)}")
        return self


class CampaignSettings(Settings):
    """A campaign."""

    seed: Annotated[int, Field(ge=0, le=SEED_MAX)] = 1
    ftti_ms: float = Field(150.0, ge=20.0, le=10_000.0)
    """Fault tolerant time interval: detection and reaction together are to be within it."""
    motion_s: float = Field(6.5, ge=1.0, le=600.0)
    onset_s: float = Field(2.0, ge=0.1, le=300.0)
    """Time after the start of motion; the place within a control period is drawn for each run."""
    fault_s: float = Field(1.0, ge=0.01, le=100.0)
    golden_seeds: Annotated[int, Field(ge=1, le=1000)] = 4
    """Fault-free runs at each operating point with each law."""
    bitrate_bit_s: Annotated[int, Field(ge=125_000, le=1_000_000)] = 500_000
    laws: tuple[Law, ...] = Field(("practical_pd_ddob",), min_length=1, max_length=20)
    """Presets of the controller."""
    command: tuple[str, ...] = Field((), max_length=100)
    """Words of a program that is the controller, in lockstep; it keeps to what ``laws`` say."""
    points: tuple[PointSettings, ...] = Field((PointSettings(name="nominal"),), min_length=1)
    cases: tuple[CaseSettings, ...] = ()
    node_cases: tuple[NodeCaseSettings, ...] = ()

    @model_validator(mode="after")
    def _leaves_time(self) -> Self:
        if self.onset_s + self.fault_s >= self.motion_s:
            raise ValueError("motion_s must be longer than onset_s and fault_s together")
        _refuse_twice("points", (point.name for point in self.points))
        _refuse_twice("laws", self.laws)
        for point in self.points:
            _refuse_twice(f"laws of {point.name}", point.laws)
        _refuse_twice("cases", _names_of(self.cases))
        _refuse_twice("node_cases", _names_of(self.node_cases))
        return self


def _names_of(tables: Iterable[CaseSettings | NodeCaseSettings]) -> Iterable[str]:
    """Yield the names by which runs and rows of tables are distinguished."""
    for table in tables:
        places = table.messages if isinstance(table, CaseSettings) else table.nodes
        for place in places:
            for magnitude in table.magnitudes:
                yield f"{table.kind} {magnitude:g} {place}"


def _refuse_twice(what: str, names: Iterable[str]) -> None:
    name, count = next(iter(Counter(names).most_common(1)), ("", 0))
    if count > 1:
        raise ValueError(f"{what} must differ: {name!r} is there {count} times")


def direction_of(message: str) -> FaultDirection:
    """Return which way a message goes."""
    if MESSAGE_TYPES[message] in MESSAGES_OF[FaultDirection.DOWNLINK]:
        return FaultDirection.DOWNLINK
    return FaultDirection.UPLINK
