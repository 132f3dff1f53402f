"""Print what an intruder without a key costs a live pair, beside silence of the same length.

    python -m tests.soak.live_attacks [--load 4]
    tools/with_vcan .venv/bin/python -m tests.soak.live_attacks --channel vcan0

Each strategy of ``tests.system.test_second_senders`` runs for two seconds against the two programs
on an emulated bus, or on ``--channel``. ``--load`` starts so many processes that are always busy.
A row has the largest lateral error [m] while commands are forged, and while measurements are. Takes
about four minutes.
"""

import argparse
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from os import getloadavg
from pathlib import Path
from tempfile import TemporaryDirectory

from steer_by_wire.closed_loop.live_bus import Bus
from steer_by_wire.closed_loop.live_pair import PROGRAMS, LivePair
from steer_by_wire.closed_loop.pair_result import PLANT, PairFiles
from steer_by_wire.closed_loop.process_group import ProcessError, launched_broker
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.real_time_loop import RealTimeExecutor
from steer_by_wire.runtime.port.python_can import BusPort, shutting_down
from tests.support.intruder import Attack, Intruder
from tests.support.running_program import UNSUPERVISED
from tests.system.test_second_senders import ATTACK_NS, CONTROLLER, ONSET_NS, STRATEGIES

DURATION_S = 6.0
VALUES = {SteeringCommand: 0.6, LateralError: 0.2}
"""What is forged of each message [rad], [m]."""
OPTIONS = dict.fromkeys(PROGRAMS, UNSUPERVISED)
"""On a loaded machine a node that misses its periods would end for that."""
SILENCES = (("STEERING_COMMAND", "downlink"), ("LATERAL_ERROR", "uplink"))


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
    """Attacks so long after the first command."""

    def __init__(self, attack: Attack) -> None:
        super().__init__(attack)
        self._is_begun = False

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        if not self._is_begun and frame.can_id == CAN_IDS[SteeringCommand]:
            self._is_begun = True
            self._attack = self._attack._replace(onset_ns=now_ns + self._attack.onset_ns)
        return super().on_frame(frame, now_ns) if self._is_begun else ()


@contextmanager
def intruding(bus: Bus, attack: Attack) -> Iterator[None]:
    """Attack within the block, in a thread."""
    stop, port = threading.Event(), BusPort(bus.open())
    executor = RealTimeExecutor(LiveIntruder(attack), port)
    thread = threading.Thread(target=executor.run, args=(stop.is_set,))
    with shutting_down(port):
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def peak_m(bus: Bus, plant: PlantSettings, attack: Attack | None = None) -> float:
    """Run the pair to the end of its motion, beside an intruder if there is one."""
    with TemporaryDirectory() as folder, ExitStack() as stack:
        files = PairFiles(Path(folder))
        files.write_settings(plant, CONTROLLER)
        if attack is not None:
            stack.enter_context(intruding(bus, attack))
        pair = stack.enter_context(LivePair(bus, files, options=OPTIONS, is_recorded=False))
        while pair.plant_is_running:
            time.sleep(0.1)
        return float(pair.report(PLANT)["node"]["lateral_error_peak_m"])


def silent(message: str, direction: str) -> PlantSettings:
    """Return settings of a plant that a message does not reach, or leave, for as long."""
    fault = {"kind": "drop", "message": message, "direction": direction, "magnitude": 1.0}
    times = {"onset_s": ONSET_NS / NS_PER_S, "duration_s": ATTACK_NS / NS_PER_S}
    return PlantSettings.model_validate({"duration_s": DURATION_S, "faults": [{**fault, **times}]})


def attacked(bus: Bus, attack: Attack) -> str:
    """Return the largest error of an attack [m], or how a program has failed."""
    try:
        return f"{peak_m(bus, PlantSettings(duration_s=DURATION_S), attack):.2f}"
    except ProcessError as error:
        return str(error)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.live_attacks")
    parser.add_argument("--channel", help="of SocketCAN; without it the emulated bus")
    parser.add_argument("--load", type=int, default=0, metavar="N")
    asked = parser.parse_args(arguments)
    console = plain_console()
    with ExitStack() as stack:
        stack.enter_context(load(asked.load))
        if asked.channel is None:
            address = stack.enter_context(launched_broker())
            bus = Bus("emulated", "can0", {"address": address})
        else:
            bus = Bus("socketcan", asked.channel, {})
        console.print(f"{'':45} commands  measurements")
        silences_m = [peak_m(bus, silent(*one)) for one in SILENCES]
        console.print(f"{'silence':45} {silences_m[0]:8.2f} {silences_m[1]:13.2f}")
        for name, (shots, repeats) in STRATEGIES.items():
            peaks = [
                attacked(bus, Attack(kind, value, ONSET_NS, ATTACK_NS, shots, repeats))
                for kind, value in VALUES.items()
            ]
            console.print(f"{name:45} {peaks[0]:>8} {peaks[1]:>13}")
        console.print(f"load of the machine in the last minute: {getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
