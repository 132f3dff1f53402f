"""Desk of the cockpit: fulfils what pages ask for, in order, and keeps what all of them show.

Starting and ending programs takes seconds, so it is done in a thread of its own.
"""

import asyncio
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from ...closed_loop.reports.law_colours import law_lines
from ...dbc.messages import Direction, DisturbanceConfig, LatencyConfig, LatencyModel, encode
from ...plant_emulator.network.latency_distributions import Distribution
from ...runtime.exit_status import BusError
from ...runtime.settings import Settings, SettingsError
from .hand import SPEED_M_S_MAX
from .lane import Lane
from .lanes import Action, OwnLanes, Program, lane_facts
from .orders import HAND_WHEELS, Orders
from .scenario import LANES_MAX, Latency, Scenario, choices, scenario_of
from .signals import ROW_PERIOD_S, shown

LISTENS_ONLY = "this page only listens; --allow-control lets it change the latency"
NOT_OURS = "only the pairs that the cockpit has started itself can be started, killed or paused"


class SetLatency(Settings):
    """Change the latency of one direction, or of both, in every lane."""

    do: Literal["latency"]
    direction: Literal["downlink", "uplink", "both"]
    latency: Latency

    @property
    def message(self) -> LatencyConfig:
        """What is sent for it."""
        way, own = Direction[self.direction.upper()], self.latency
        return LatencyConfig(
            direction=way,
            model=LatencyModel[Distribution(own.model).name],
            mean_s=own.mean_s,
            spread_s=own.spread_s,
            loss=own.loss,
        )


class Disturb(Settings):
    """Let these disturbances act from now on, in every lane."""

    do: Literal["disturb"]
    side_force_n: Annotated[float, Field(ge=-32767.0, le=32767.0)]
    steering_offset_rad: Annotated[float, Field(ge=-0.5, le=0.5)]
    friction: Annotated[float, Field(ge=0.05, le=1.0)]

    @property
    def message(self) -> DisturbanceConfig:
        """What is sent for it."""
        return DisturbanceConfig(
            side_force_n=self.side_force_n,
            yaw_moment_n_m=0.0,
            steering_offset_rad=self.steering_offset_rad,
            friction_loss=1.0 - self.friction,
        )


class Start(Settings):
    """Restart a scenario; ``scenario`` is checked where it is used."""

    do: Literal["start"]
    scenario: dict[str, Any]


class Steer(Settings):
    """Report the visitor's orders (``Orders``)."""

    do: Literal["steer"]
    steer_rad: Annotated[float, Field(ge=-0.6, le=0.6)]
    grip: Literal["hands_off", "loose", "light", "firm"] = "light"
    speed_m_s: Annotated[float, Field(ge=0.0, le=SPEED_M_S_MAX)] = 0.0
    wheel: Literal["", "hand_wheel", "hand_wheel_damped", "hand_wheel_cdob"] = ""


class Act(Settings):
    """Kill, pause, resume or restart one process."""

    do: Literal["process"]
    lane: Annotated[int, Field(ge=0, lt=LANES_MAX)]
    program: Program
    action: Action


class Record(Settings):
    """Begin or end a recording of every lane."""

    do: Literal["record"]
    on: bool


class ResetFigures(Settings):
    """Let the running figures start again."""

    do: Literal["reset"]


Wish = Annotated[
    SetLatency | Disturb | Start | Steer | Act | Record | ResetFigures, Field(discriminator="do")
]
_WISH: TypeAdapter[Wish] = TypeAdapter(Wish)


class WishError(ValueError):
    """A wish that cannot be fulfilled; the text is one line for the page."""


def wish_of(text: str) -> Wish:
    """Return the wish in a message of a page; raises WishError."""
    try:
        return _WISH.validate_json(text, strict=True)
    except ValidationError as error:
        mistake = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, mistake["loc"]))
        raise WishError(f"{where or 'message'}: {mistake['msg']}") from error


class Desk:
    """The lanes and what may be done to them.

    ``own``          runs our own pairs; None where a foreign bus is listened to
    ``lane``         that bus; None with pairs of our own
    ``may_control``  whether frames may be sent
    """

    def __init__(
        self, own: OwnLanes | None, lane: Lane | None, bus: str, *, may_control: bool
    ) -> None:
        self._own = own
        self._foreign = lane
        self._bus = bus
        self._may_control = may_control
        self._worker = ThreadPoolExecutor(1, "desk")
        self._stack = ExitStack()
        made = TemporaryDirectory(prefix="steer-by-wire-recordings-", ignore_cleanup_errors=True)
        self.recordings = Path(self._stack.enter_context(made))
        self._recording_since: float | None = None
        self._scenario: Scenario | None = None
        self._busy = ""
        self.generation = 0

    @property
    def lanes(self) -> Sequence[Lane]:
        """The lanes of now."""
        if self._own is not None:
            return self._own.lanes
        return () if self._foreign is None else (self._foreign,)

    async def start(self, scenario: Scenario) -> None:
        """Start a scenario; raises what ``OwnLanes.start`` raises."""
        await self._in_thread(lambda: self._start(scenario), f"starting {scenario.title}")

    async def fulfil(self, text: str) -> str:
        """Fulfil the wish in a message; returns a line that says why not, empty when it was."""
        try:
            wish = wish_of(text)
            if not self._may_control and not isinstance(wish, ResetFigures | Record):
                return LISTENS_ONLY
            if isinstance(wish, Steer):  # at once, and not behind a wish that takes seconds
                self._steer(wish)
                return ""
            busy = "starting the programs" if isinstance(wish, Start) else ""
            await self._in_thread(lambda: self._fulfil(wish), busy)
        except (WishError, SettingsError, BusError, OSError, RuntimeError) as error:
            return " ".join(str(error).splitlines())
        return ""

    def hello(self) -> Mapping[str, Any]:
        """Return all that a page needs before the first row, ready for JSON."""
        bus = lane_facts("bus", law_lines([""])[0])
        facts = [bus] if self._own is None else self._own.facts
        laws = () if self._scenario is None else self._scenario.controllers
        has_hand_wheel = not HAND_WHEELS.keys().isdisjoint(laws)
        return {
            "kind": "hello",
            **shown(has_hand_wheel=has_hand_wheel),
            "row_period_s": ROW_PERIOD_S,
            "lanes": [lane._asdict() for lane in facts],
            "bus": self._bus if self._own is None else self._own.bus,
            "may_control": self._may_control,
            "is_own": self._own is not None,
            "choices": choices(),
            "scenario": self._scenario and self._scenario.model_dump(mode="json"),
        }

    def status(self) -> Mapping[str, Any]:
        """Return what changes a few times a second, ready for JSON."""
        is_recording = any(lane.is_recording for lane in self.lanes)
        since = self._recording_since if is_recording else None
        return {
            "kind": "status",
            "lanes": [lane.status for lane in self.lanes],
            "programs": [] if self._own is None else self._own.states(),
            "recording_s": None if since is None else round(time.monotonic() - since, 1),
            "recorded": sorted(file.name for file in self.recordings.glob("*.log")),
            "busy": self._busy,
        }

    async def close(self) -> None:
        """End everything that was started."""
        await asyncio.get_running_loop().run_in_executor(self._worker, self._close)
        self._worker.shutdown()

    async def _in_thread(self, work: Any, busy: str) -> None:
        self._busy = busy
        try:
            await asyncio.get_running_loop().run_in_executor(self._worker, work)
        finally:
            self._busy = ""

    def _fulfil(self, wish: Wish) -> None:
        match wish:
            case SetLatency() | Disturb():
                for lane in self.lanes:
                    lane.send([encode(wish.message, 0)])
            case Start():
                self._start(scenario_of(wish.scenario))
            case Act():
                self._own_lanes().act(wish.lane, wish.program, wish.action)
            case Record():
                self._record(wish.on)
            case ResetFigures():
                for lane in self.lanes:
                    lane.reset_figures()

    def _steer(self, wish: Steer) -> None:
        hand = self._own_lanes().hand
        if hand is not None:
            orders = Orders(wish.steer_rad, wish.grip, wish.speed_m_s, wish.wheel)
            hand.write(orders, time.monotonic_ns())

    def _own_lanes(self) -> OwnLanes:
        if self._own is None:
            raise WishError(NOT_OURS)
        return self._own

    def _start(self, scenario: Scenario) -> None:
        """Start a scenario; a page is told at once what comes, and again when it runs."""
        own = self._own_lanes()
        settings = own.settings_of(scenario)
        own.stop()
        self._recording_since = None
        self._scenario = scenario
        self.generation += 1
        own.start(settings)
        self.generation += 1

    def _record(self, on: bool) -> None:
        for number, lane in enumerate(self.lanes, start=1):
            lane.record(self.recordings / f"lane{number}.log" if on else None)
        self._recording_since = time.monotonic() if on else None

    def _close(self) -> None:
        if self._own is not None:
            self._own.stop()
        if self._foreign is not None:
            self._foreign.close()
        self._stack.close()
