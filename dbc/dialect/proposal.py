"""A first mapping from a database alone: the likely signals by name, each guess with its reason."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal

from .settings import Quantity

CYCLE_MS = 20
"""Of a message whose cycle the database does not tell."""
BITS_MIN = 8
"""Of a signal that carries a measured value."""
HAND_WHEEL_RATIO = 15.0
_ASKED = r"(desired|target|req|cmd|command|demand|lka|lkas)"
_GUESSES: Mapping[Quantity, str] = {
    Quantity.STEER: rf"{_ASKED}.*(steer|angle)|(steer|angle).*(req|cmd|target)",
    Quantity.WHEEL_ANGLE: r"(steer|swa|sas|eps|wheel).*ang",
    Quantity.SPEED: r"wheel_?speed|veh.*(speed|spd|vel)|(speed|spd).*veh|^v_?ego|^speed",
    Quantity.YAW_RATE: r"yaw",
}
"""Names of signals, the first that fits."""
_NO_ANGLE = re.compile(
    r"rate|speed|torque|valid|stat|fail|sens|offset|qual|check|fault", re.IGNORECASE
)
_ENGAGED = re.compile(r"(active|request|enable|engage|control_?type|ctrl)", re.IGNORECASE)
_COUNTER = re.compile(r"count(er)?$|_cnt$|alive|_mc$|rolling", re.IGNORECASE)
_CHECKSUM = re.compile(r"checksum|chksum|_cs$|crc", re.IGNORECASE)
_HAND_WHEEL = (Quantity.STEER, Quantity.WHEEL_ANGLE)
_UNITS = (
    (r"km/?h|kph", "km/h"),
    (r"mph|mi/h", "mph"),
    (r"deg/s|°/s|deg/sec", "deg/s"),
    (r"^deg|^°", "deg"),
)
_DEFAULT_UNITS = {Quantity.SPEED: "km/h", Quantity.YAW_RATE: "deg/s"}


class Guess(NamedTuple):
    """A signal that may carry a quantity."""

    signal: Signal
    quantity: Quantity
    unit: str
    why: str


def proposal(messages: Sequence[Message], dbc: Path) -> str:
    """Return the text of a first file; what is not sure has a comment that begins with a guess."""
    commands = {message.name for message in messages if _carries(message, Quantity.STEER)}
    blocks = [
        f"# A first mapping of {dbc.name}; each line with '# guess' is one. Check it with the car,",
        "# add constants that your controller needs to see, and messages that it waits for; then:",
        "# steer-by-wire dialect check FILE",
        f'dbc = "{dbc.name}"',
        'keep = ["LATERAL_ERROR"]  # ours: remove it where a signal carries lateral_error_m',
        "",
    ]
    for message in messages:
        sender = "controller" if message.name in commands else "plant"
        guesses = list(_guesses(message, sender))
        if guesses:
            blocks += [*_block(message, sender, guesses), ""]
    return "\n".join(blocks)


def _carries(message: Message, quantity: Quantity) -> bool:
    return any(guess.quantity is quantity for guess in _guesses(message, "controller"))


def _guesses(message: Message, sender: str) -> Iterator[Guess]:
    """Yield the signals that may carry what this end sends."""
    for signal in message.signals:
        quantity = _quantity_in(signal)
        if quantity is not None and (quantity is Quantity.STEER) == (sender == "controller"):
            unit = _unit_of(signal) or _DEFAULT_UNITS.get(quantity, "deg")
            said = f"unit {signal.unit!r}" if signal.unit else f"no unit, {unit} assumed"
            yield Guess(signal, quantity, unit, f"by its name, {said}")


def _quantity_in(signal: Signal) -> Quantity | None:
    name = signal.name
    if signal.length < BITS_MIN or _COUNTER.search(name) or _CHECKSUM.search(name):
        return None
    for quantity, pattern in _GUESSES.items():
        is_angle = quantity in _HAND_WHEEL
        if re.search(pattern, name, re.IGNORECASE) and not (is_angle and _NO_ANGLE.search(name)):
            return quantity
    return None


def _unit_of(signal: Signal) -> str:
    unit = signal.unit or ""
    return next((name for pattern, name in _UNITS if re.search(pattern, unit, re.IGNORECASE)), "")


def _block(message: Message, sender: str, guesses: Sequence[Guess]) -> list[str]:
    lines = [f"[messages.{message.name}]"]
    if sender == "controller":
        lines.append('sender = "controller"')
    known = message.cycle_time
    lines.append(
        f"cycle_ms = {known or CYCLE_MS}" + ("" if known else "  # guess: not in the database")
    )
    for signal, quantity, unit, why in guesses:
        ratio = f", ratio = {HAND_WHEEL_RATIO}" if quantity in _HAND_WHEEL else ""
        hint = "; ratio of hand wheel to road wheel" if ratio else ""
        carries = f'{{ carries = "{quantity}", unit = "{unit}"{ratio} }}'
        lines.append(f"signals.{signal.name} = {carries}  # guess: {why}{hint}")
    taken = {guess.signal.name for guess in guesses}
    rest = [signal for signal in message.signals if signal.name not in taken]
    if sender == "controller":
        switch = next((one for one in rest if one.length <= 3 and _ENGAGED.search(one.name)), None)
        if switch is not None:
            carries = '{ carries = "engaged" }'
            lines.append(f"signals.{switch.name} = {carries}  # guess: by its name")
    counter = next((one.name for one in rest if _COUNTER.search(one.name)), None)
    if counter is not None:
        lines.append(f'counter = "{counter}"  # guess: by its name')
    checksum = next((one.name for one in rest if _CHECKSUM.search(one.name)), None)
    if checksum is not None:
        rule = f'{{ signal = "{checksum}", rule = "sum" }}'
        lines.append(f"# checksum = {rule}  # guess: sum, crc, e2e_p05 or package.module:FUNCTION")
    return lines
