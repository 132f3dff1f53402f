"""Controllers that are wrong in one way each: a good one, and what is done to its commands.

    python -m tests.support.attacks.wrong_controllers NAME [options of steer-by-wire controller]

runs one of WRONG as a program.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from steer_by_wire.controller.command_line import program
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, Rejection, SteeringCommand, decode, encode
from steer_by_wire.runtime.frame import Frame

SETTINGS = controller_preset("practical_pd_ddob", ["supervision.stops_if_implausible=false"])
"""Ours would notice that the wheel does not do what it commands, and stop."""
FOREIGN_ID = 0x7A1
Change = Callable[[int, SteeringCommand, int], Sequence[Frame]]
"""Returns what is sent in place of a command: its number, message and E2E counter."""


class Changed(ControllerNode):
    """A controller whose commands are changed before they are sent."""

    def __init__(
        self, start_ns: int, change: Change, settings: ControllerSettings = SETTINGS, **options: Any
    ) -> None:
        super().__init__(settings, start_ns, **options)
        self._change, self._number = change, -1

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        sent: list[Frame] = []
        for frame in super().on_tick(now_ns):
            if frame.can_id != CAN_IDS[SteeringCommand]:
                sent.append(frame)
                continue
            decoded = decode(frame)
            assert not isinstance(decoded, Rejection)
            assert isinstance(decoded.message, SteeringCommand)
            self._number += 1
            sent += self._change(self._number, decoded.message, decoded.counter)
        return sent


def steers(function: Callable[[int, float], float]) -> Change:
    """Return the change of the angle alone; ``function`` gets number and angle [rad]."""

    def change(number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
        steer_rad = min(max(function(number, command.steer_rad), -1.0), 1.0)
        return [encode(command._replace(steer_rad=steer_rad), counter)]

    return change


def sends(is_sent: Callable[[int], bool]) -> Change:
    """Return the change that leaves out commands, and counts those that are sent."""
    count = 0

    def change(number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
        nonlocal count
        if not is_sent(number):
            return []
        count += 1
        return [encode(command._replace(command_counter=count), count % 256)]

    return change


def repeats(_number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
    return [encode(command._replace(command_counter=7), 7)]


def damages(_number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
    frame = encode(command, counter)
    return [frame._replace(data=bytes([frame.data[0] ^ 1, *frame.data[1:]]))]


def doubles(number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
    pair = (2 * number, 2 * number + 1)
    return [encode(command._replace(command_counter=k), k % 256) for k in pair]


def floods(_number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
    return [encode(command, counter), *[Frame(FOREIGN_ID, bytes(8))] * 3]


def late(by: int) -> Change:
    queue: list[float] = []

    def delayed(_number: int, steer_rad: float) -> float:
        queue.append(steer_rad)
        return queue.pop(0) if len(queue) > by else 0.0

    return steers(delayed)


NEVER = "the plant was never driven: no valid command arrived"
WRONG: Mapping[str, tuple[Callable[[], Change], str]] = {
    "silent": (lambda: sends(lambda _number: False), NEVER),
    "damaged CRC": (lambda: damages, NEVER),
    "silent from 3 s on": (lambda: sends(lambda n: n < 300), "the plant fell back: for "),
    "silent for a second": (lambda: sends(lambda n: n % 500 < 400), "the plant fell back: for "),
    "the same counter": (lambda: repeats, "the plant fell back: for "),
    "wrong sign": (lambda: steers(lambda _n, rad: -rad), "verdict: "),
    "always straight": (lambda: steers(lambda _n, _rad: 0.0), "verdict: "),
    "constant": (lambda: steers(lambda _n, _rad: 0.1), "verdict: "),
    "drifts": (lambda: steers(lambda n, rad: rad + 1e-3 * n), "verdict: "),
    "thirty times the gain": (lambda: steers(lambda _n, rad: 30.0 * rad), "verdict: "),
    "weak": (lambda: steers(lambda _n, rad: 0.02 * rad), "verdict: "),
    "saturates early": (lambda: steers(lambda _n, rad: min(max(rad, -0.02), 0.02)), "verdict: "),
    "late by 0.6 s": (lambda: late(60), "verdict: "),
    "shakes the wheel": (
        lambda: steers(lambda n, rad: rad + 0.15 * (1 if n // 10 % 2 else -1)),
        "verdict: limit cycle: ",
    ),
    "one side only": (lambda: steers(lambda _n, rad: min(rad, 0.0)), "verdict: "),
    "half its rate": (lambda: sends(lambda n: n % 2 == 0), "commands at 50 Hz instead of 100 Hz"),
    "a tenth of its rate": (lambda: sends(lambda n: n % 10 == 0), "commands at 10 Hz instead of "),
    "twice its rate": (lambda: doubles, "commands at 200 Hz instead of 100 Hz"),
    "floods": (lambda: floods, "floods the bus: 4"),
}

RIGHT = (
    *("practical_pd", "practical_pid", "practical_pd_cdob", "practical_pd_ddob"),
    *("practical_smith", "practical_predictor", "practical_packet", "paper_pd"),
)


def main(name: str, *arguments: str) -> int:
    """Run one of WRONG on a bus; returns its exit status."""
    change = WRONG[name][0]()

    def changed(settings: ControllerSettings, start_ns: int, **options: Any) -> ControllerNode:
        return Changed(start_ns, change, settings, **options)

    vars(program)["ControllerNode"] = changed
    return program.main(arguments)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
