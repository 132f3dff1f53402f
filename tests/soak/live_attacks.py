"""Print what an intruder without a key costs a live pair, beside silence of the same length.

    python -m tests.soak.live_attacks [--load 4] [--only "one" "a burst"]
    tools/with_vcan .venv/bin/python -m tests.soak.live_attacks --channel vcan0

Each strategy of ``tests.system.test_second_senders`` runs for two seconds against the two programs
on an emulated bus, or on ``--channel``. ``--load`` starts so many processes that are always busy.
A row is one of them against commands, or against measurements:

    cost [m]   the largest lateral error, beside that of silence in the same message
    forged     frames that left within LATE_NS of when the strategy wants them, of how many it wants
    followed   sensor periods in which the plant had a forged command in effect

A row that forged less than VALID_SHARE proves nothing, says so, and makes the status 1. Takes about
four minutes.
"""

import argparse
import csv
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from os import getloadavg
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, Self

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.live_pair import PROGRAMS, LivePair
from steer_by_wire.closed_loop.pair.pair_result import PLANT_PROGRAM, PairFiles
from steer_by_wire.closed_loop.processes.process_group import ProcessError, launched_broker
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    MESSAGE_TYPES,
    LateralError,
    Message,
    SteeringCommand,
)
from steer_by_wire.dbc.reception import cycle_ns
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.node.real_time_loop import RealTimeExecutor
from steer_by_wire.runtime.port.python_can import BusPort, shutting_down
from tests.support.attacks.intruder import Attack, Intruder
from tests.support.programs.running_program import UNSUPERVISED
from tests.system.test_second_senders import ATTACK_NS, CONTROLLER, ONSET_NS, STRATEGIES

DURATION_S = 6.0
VALUES = {SteeringCommand: 0.6, LateralError: 0.2}
"""What is forged of each message [rad], [m]."""
OPTIONS = dict.fromkeys(PROGRAMS, UNSUPERVISED)
"""On a loaded machine a node that misses its periods would end for that."""
SILENCES = {SteeringCommand: "downlink", LateralError: "uplink"}
MESSAGE_NAMES = {kind: name for name, kind in MESSAGE_TYPES.items()}
LATE_NS = 5 * NS_PER_MS
"""Half a cycle: by then a forged frame is as near to the next true frame as to its own."""
VALID_SHARE = 0.9


class Outcome(NamedTuple):
    """What a run has shown, as in the columns of the table."""

    peak_m: float
    forged: int
    followed: int


@contextmanager
def load(processes: int) -> Iterator[None]:
    """Keep so many processes busy within the block."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for one in busy:
            one.kill()
            one.wait()


class LiveIntruder(Intruder):
    """Attacks so long after the first command.

    ``late``  frames that left later than LATE_NS after they were due
    """

    def __init__(self, attack: Attack) -> None:
        super().__init__(attack)
        self._is_begun = False
        self.late = 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        if not self._is_begun and frame.can_id == CAN_IDS[SteeringCommand]:
            self._is_begun = True
            self._attack = self._attack._replace(onset_ns=now_ns + self._attack.onset_ns)
        return super().on_frame(frame, now_ns) if self._is_begun else ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.late += sum(now_ns - due_ns > LATE_NS for due_ns, _, _ in self._waiting)
        return super().on_tick(now_ns)


class LiveAttack:
    """An intruder in a thread of this process, within the block; afterwards what it has forged."""

    def __init__(self, bus: Bus, attack: Attack) -> None:
        self._stop, self._port = threading.Event(), BusPort(bus.open())
        self._intruder = LiveIntruder(attack)
        self._executor = RealTimeExecutor(self._intruder, self._port)
        self._thread = threading.Thread(target=self._executor.run, args=(self._stop.is_set,))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with shutting_down(self._port):
            self._stop.set()
            self._thread.join()

    @property
    def forged(self) -> int:
        """Frames that the bus took in time."""
        return self._executor.figures.frames_sent - self._intruder.late


def run(bus: Bus, plant: PlantSettings, attack: Attack | None = None) -> Outcome:
    """Run the pair to the end of its motion, beside an intruder if there is one."""
    with TemporaryDirectory() as folder, ExitStack() as stack:
        files = PairFiles(Path(folder))
        files.write_settings(plant, CONTROLLER)
        intruder = None if attack is None else stack.enter_context(LiveAttack(bus, attack))
        options = {**OPTIONS, PLANT_PROGRAM: (*UNSUPERVISED, "--trace", str(files.plant_trace))}
        pair = stack.enter_context(LivePair(bus, files, options=options, is_recorded=False))
        while pair.plant_is_running:
            time.sleep(0.1)
        peak_m = float(pair.report(PLANT_PROGRAM)["node"]["lateral_error_peak_m"])
        followed = samples_with(files.plant_trace, VALUES[SteeringCommand])
        return Outcome(peak_m, 0 if intruder is None else intruder.forged, followed)


def samples_with(trace: Path, command_rad: float) -> int:
    """Return in how many samples of a plant's trace a command was in effect."""
    with trace.open(newline="", encoding="utf-8") as file:
        commands_rad = [float(row["command_rad"] or "nan") for row in csv.DictReader(file)]
    return sum(abs(one - command_rad) < 1e-3 for one in commands_rad)


def wanted(attack: Attack) -> int:
    """Return how many frames an attack forges if it hears every true frame."""
    true_frames = attack.lasts_ns // cycle_ns(attack.kind)
    if not attack.repeats:
        return sum(map(len, attack.shots[:true_frames]))
    return sum(len(attack.shots[n % len(attack.shots)]) for n in range(true_frames))


def silent(kind: type[Message]) -> PlantSettings:
    """Return settings of a plant that a message does not reach, or leave, for as long."""
    fault = {"kind": "drop", "message": MESSAGE_NAMES[kind], "direction": SILENCES[kind]}
    times = {"onset_s": ONSET_NS / NS_PER_S, "duration_s": ATTACK_NS / NS_PER_S}
    faults = [{**fault, **times, "magnitude": 1.0}]
    return PlantSettings.model_validate({"duration_s": DURATION_S, "faults": faults})


def rows(bus: Bus, kind: type[Message], names: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Yield the lines of a message, and whether each is valid."""
    message = MESSAGE_NAMES[kind]
    silence = run(bus, silent(kind))
    yield f"{message:17} {'silence':33} {silence.peak_m:8.2f}", True
    for name in names:
        attack = Attack(kind, VALUES[kind], ONSET_NS, ATTACK_NS, *STRATEGIES[name])
        try:
            found = run(bus, PlantSettings(duration_s=DURATION_S), attack)
        except ProcessError as error:
            yield f"{message:17} {name:33} {error}", False
            continue
        aim = wanted(attack)
        is_valid = found.forged >= VALID_SHARE * aim
        followed = found.followed if kind is SteeringCommand else "-"
        text = (
            f"{message:17} {name:33} {found.peak_m:8.2f} {found.forged:5} of {aim:4} {followed:>9}"
        )
        yield f"{text}{'' if is_valid else '  not valid: too few forged'}", is_valid


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.live_attacks")
    parser.add_argument("--channel", help="of SocketCAN; without it the emulated bus")
    parser.add_argument("--load", type=int, default=0, metavar="N")
    parser.add_argument("--only", nargs="+", choices=STRATEGIES, default=list(STRATEGIES))
    asked = parser.parse_args(arguments)
    console, invalid = plain_console(), 0
    with ExitStack() as stack:
        stack.enter_context(load(asked.load))
        if asked.channel is None:
            address = stack.enter_context(launched_broker())
            bus = Bus("emulated", "can0", {"address": address})
        else:
            bus = Bus("socketcan", asked.channel, {})
        console.print(f"{'':51} cost [m]        forged  followed")
        for kind in VALUES:
            for line, is_valid in rows(bus, kind, asked.only):
                console.print(line)
                invalid += not is_valid
        console.print(f"{invalid} rows not valid; load in the last minute: {getloadavg()[0]:.1f}")
    return bool(invalid)


if __name__ == "__main__":
    sys.exit(main())
