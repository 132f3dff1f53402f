"""A first mapping from a database alone: the likely signals by name, each guess with its reason."""

import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal

from ...runtime.node.end import End
from ..foreign_messages import cycle_ms_of
from .car_message import signal_range
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
_LATERAL = re.compile(
    r"(^|_)(lat(eral)?|cross_?track|path|lane|trajectory)_?(\w*_)?(of+s|dev|err)"
    r"|(lane|path)_(poly_)?c_?0$|of+s\w*_(from_)?(lane|path)_?(c|$)"
    r"|(^|_)(xte|cte)(_|$)|cross_?track"
)
"""Names of a lateral error, in words: ``OffstLaneCntr`` as ``offst_lane_cntr``."""
_NOT_LATERAL = re.compile(
    r"left|right|(^|_)(lft|rgt|obj|object|target|tgt|trk|mp|map|gps|sens|sensor|light|ctr_lat)(_|$)"
    r"|mount|rate|vel|acc|conf|desired|limit|valid|stat|fail|qual|check|fault|flag|turn|trn"
)
_LATERAL_MAX_M = 60.0
"""A range beyond is that of a map or of an object far ahead."""
_LENGTHS = {"": 1.0, "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "cm": 100.0, "mm": 1e3}
_HAND_WHEEL = (Quantity.STEER, Quantity.WHEEL_ANGLE)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
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
    ratio: float = 1.0


def proposal(messages: Sequence[Message], dbc: Path) -> str:
    """Return the text of a first file; what is not sure has a comment that begins with a guess."""
    commands = {message.name for message in messages if _carries(message, Quantity.STEER)}
    lateral = _lateral(one for one in messages if one.name not in commands)
    keep = 'keep = ["LATERAL_ERROR"]  # ours: remove it where a signal carries lateral_error_m'
    if lateral is not None:
        name = f"{lateral[0].name}.{lateral[1].signal.name}"
        keep = f'# keep = ["LATERAL_ERROR"]  # ours, in place of {name}, if that guess is wrong'
    head = [
        f"# A first mapping of {dbc.name}; each line with '# guess' is one. Check it with the car,",
        "# add constants that your controller needs to see, and messages that it waits for; then:",
        "# steer-by-wire dialect check FILE",
        f"dbc = {_quoted(dbc.name)}",
        keep,
    ]
    tables: dict[str, list[str]] = {}
    for message in messages:
        sender = End.CONTROLLER if message.name in commands else End.PLANT
        guesses = list(_guesses(message, sender))
        guesses += [lateral[1]] if lateral is not None and lateral[0] is message else []
        if guesses:
            once = {guess.signal.name: guess for guess in guesses}
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
        name = _key(place.removeprefix("messages."))
        told = [f"# {name} is left out: {why}" for why in whys]
        tables[place] = told + [f"# {line}" for line in tables[place]]
    return "\n\n".join("\n".join(lines) for lines in (head, *tables.values())) + "\n"


def _carries(message: Message, quantity: Quantity) -> bool:
    return any(guess.quantity is quantity for guess in _guesses(message, End.CONTROLLER))


def _guesses(message: Message, sender: str) -> Iterator[Guess]:
    for signal in message.signals:
        quantity = _quantity_in(signal)
        if quantity is not None and (quantity is Quantity.STEER) == (sender == End.CONTROLLER):
            unit = _unit_of(signal) or _DEFAULT_UNITS.get(quantity, "deg")
            said = f"unit {signal.unit!r}" if signal.unit else f"no unit, {unit} assumed"
            ratio = HAND_WHEEL_RATIO if quantity in _HAND_WHEEL else 1.0
            yield Guess(signal, quantity, unit, f"by its name, {said}", ratio)


def _lateral(messages: Iterable[Message]) -> tuple[Message, Guess] | None:
    """Return the signal that most likely carries the lateral error, with its message.

    Of several the first with a unit of length; in one message, too, only one is taken.
    """
    found: list[tuple[Message, Guess]] = []
    for message in messages:
        for signal in message.signals:
            words = "_".join(_WORD.findall(signal.name)).lower()
            unit = (signal.unit or "").strip().lower()
            low, high = signal_range(signal)
            is_named = _LATERAL.search(words) and not _NOT_LATERAL.search(words)
            is_length = unit in _LENGTHS and signal.length >= BITS_MIN
            if is_named and is_length and low < 0.0 < high <= _LATERAL_MAX_M * _LENGTHS[unit]:
                why = f"by its name, unit {unit!r}" if unit else "by its name, no unit, m assumed"
                why += "; left of the path is positive, else a negative ratio"
                ratio = _LENGTHS[unit]
                guess = Guess(signal, Quantity.LATERAL_ERROR, "SI", why, ratio)
                found.append((message, guess))
    return min(found, key=lambda one: not one[1].signal.unit, default=None)


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


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _block(message: Message, sender: str, guesses: Sequence[Guess]) -> list[str]:
    lines = [f"[messages.{_key(message.name)}]"]
    if sender == End.CONTROLLER:
        lines.append('sender = "controller"')
    known = cycle_ms_of(message)
    cycle_ms = min(max(known or CYCLE_MS, CYCLE_MS_MIN), CYCLE_MS_MAX)
    why = "" if known == cycle_ms else f"  # guess: {known or 'not'} in the database"
    lines.append(f"cycle_ms = {cycle_ms:g}{why}")
    for signal, quantity, unit, why, factor in guesses:
        hint = "; ratio of hand wheel to road wheel" if quantity in _HAND_WHEEL else ""
        ratio = f", ratio = {factor}" if factor != 1.0 else ""
        carries = f'{{ carries = "{quantity}", unit = "{unit}"{ratio} }}'
        lines.append(f"signals.{_key(signal.name)} = {carries}  # guess: {why}{hint}")
    taken = {guess.signal.name for guess in guesses}
    rest = [signal for signal in message.signals if signal.name not in taken]
    if sender == End.CONTROLLER:
        switch = next((one for one in rest if one.length <= 3 and _ENGAGED.search(one.name)), None)
        if switch is not None:
            carries = '{ carries = "engaged" }'
            lines.append(f"signals.{_key(switch.name)} = {carries}  # guess: by its name")
    counter = next((one.name for one in rest if _COUNTER.search(one.name)), None)
    if counter is not None:
        lines.append(f"counter = {_quoted(counter)}  # guess: by its name")
    checksum = next((one.name for one in rest if _CHECKSUM.search(one.name)), None)
    if checksum is not None:
        rule = f'{{ signal = {_quoted(checksum)}, rule = "sum" }}'
        lines.append(f"# checksum = {rule}  # guess: sum, crc, e2e_p05 or package.module:FUNCTION")
    return lines
