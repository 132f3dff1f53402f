"""A first mapping from a database alone: the likely signals by name, each guess with its reason."""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal

from ...runtime.node.end import End
from ...runtime.settings.toml_text import toml_key, toml_value
from ..foreign_messages import cycle_ms_of
from .dialect import checked
from .settings import CYCLE_MS_MAX, CYCLE_MS_MIN, DialectSettings, Quantity

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
    (r"^(rad|m/s)", "SI"),
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
    head = [
        f"# A first mapping of {dbc.name}; each line with '# guess' is one. Check it with the car,",
        "# add constants that your controller needs to see, and messages that it waits for; then:",
        "# steer-by-wire dialect check FILE",
        f"dbc = {toml_value(dbc.name)}",
        'keep = ["LATERAL_ERROR"]  # ours: remove it where a signal carries lateral_error_m',
    ]
    tables: dict[str, list[str]] = {}
    for message in messages:
        guesses = list(_guesses(message))
        commands = [guess for guess in guesses if guess.quantity is Quantity.STEER]
        if guesses:
            once = {guess.signal.name: guess for guess in commands or guesses}
            sender = End.CONTROLLER if commands else End.PLANT
            tables[f"messages.{message.name}"] = _block(message, sender, [*once.values()])
    mistakes: Sequence[tuple[str, str]] = ()
    if not tables:
        head.append(
            "# No signal is named as steering is: write the tables [messages.NAME] by hand."
        )
    else:
        text = "\n".join([*head, *chain(*tables.values())])
        settings = DialectSettings.model_validate(tomllib.loads(text))
        _, mistakes = checked(settings, messages, dbc)
    for place in tables.keys() & dict(mistakes).keys():  # check would refuse them
        whys = [mistake.lstrip(".: ") for where, mistake in mistakes if where == place]
        name = toml_key(place.removeprefix("messages."))
        told = [f"# {name} is left out: {why}" for why in whys]
        tables[place] = told + [f"# {line}" for line in tables[place]]
    return "\n\n".join("\n".join(lines) for lines in (head, *tables.values())) + "\n"


def _guesses(message: Message) -> Iterator[Guess]:
    for signal in message.signals:
        quantity = _quantity_in(signal)
        if quantity is not None:
            unit, assumed = _unit_of(signal), _DEFAULT_UNITS.get(quantity, "deg")
            said = f"unit {signal.unit!r}" if signal.unit else "no unit"
            said += "" if unit else f", {assumed} assumed"
            yield Guess(signal, quantity, unit or assumed, f"by its name, {said}")


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
    lines = [f"[messages.{toml_key(message.name)}]"]
    if sender == End.CONTROLLER:
        lines.append('sender = "controller"')
    known = cycle_ms_of(message)
    cycle_ms = min(max(known or CYCLE_MS, CYCLE_MS_MIN), CYCLE_MS_MAX)
    why = "" if known == cycle_ms else f"  # guess: {known or 'not'} in the database"
    lines.append(f"cycle_ms = {cycle_ms:g}{why}")
    for signal, quantity, unit, why in guesses:
        hint = ratio = ""
        if quantity in _HAND_WHEEL:
            hint, ratio = "; ratio of hand wheel to road wheel", f", ratio = {HAND_WHEEL_RATIO}"
        carries = f'{{ carries = "{quantity}", unit = "{unit}"{ratio} }}'
        lines.append(f"signals.{toml_key(signal.name)} = {carries}  # guess: {why}{hint}")
    taken = {guess.signal.name for guess in guesses}
    rest = [signal for signal in message.signals if signal.name not in taken]
    if sender == End.CONTROLLER:
        switch = next((one for one in rest if one.length <= 3 and _ENGAGED.search(one.name)), None)
        if switch is not None:
            carries = '{ carries = "engaged" }'
            lines.append(f"signals.{toml_key(switch.name)} = {carries}  # guess: by its name")
    counter = next((one.name for one in rest if _COUNTER.search(one.name)), None)
    if counter is not None:
        lines.append(f"counter = {toml_value(counter)}  # guess: by its name")
    checksum = next((one.name for one in rest if _CHECKSUM.search(one.name)), None)
    if checksum is not None:
        rule = f'{{ signal = {toml_value(checksum)}, rule = "sum" }}'
        lines.append(f"# checksum = {rule}  # guess: sum, crc, e2e_p05 or package.module:FUNCTION")
    return lines
