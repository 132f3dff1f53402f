"""What the file of a dialect asks of a message and the database does not allow."""

from collections.abc import Iterator
from itertools import combinations

from cantools.database.can import Message, Signal

from ...runtime.frame.length_with_stuff_bits import DATA_LENGTH_CODE
from ...runtime.settings import SettingsError
from ...runtime.settings.mistakes import hint
from ...runtime.settings.plugin import cause
from .car_message import CarMessage, Refused, bits_of, raw_constant
from .checksum import CrcRule
from .quantities import COMMANDS
from .settings import CONTROLLER, MessageSettings, Quantity


def mistakes_in(message: Message, settings: MessageSettings) -> Iterator[str]:
    """Yield each mistake, beginning with its key in the message's table."""
    signals = {signal.name: signal for signal in message.signals}
    named = _named(settings)
    unknown = [(key, name) for key, name in named if name not in signals]
    for key, name in unknown:
        yield f".{key}: {message.name} has no signal {name} ({hint(name, signals)})"
    if message.length not in DATA_LENGTH_CODE:
        yield f": {message.length} bytes are the length of no frame (allowed: {_LENGTHS})"
    for signal in message.signals:
        if max(bits_of(signal)) >= 8 * message.length:
            yield f": signal {signal.name} ends beyond its {message.length} bytes"
    for name, one in settings.signals.items():
        if (one.carries in COMMANDS) != (settings.sender == CONTROLLER):
            other = "controller" if one.carries in COMMANDS else "plant"
            yield f".signals.{name}: {one.carries} is sent by the {other}"
        if not one.ratio:
            yield f".signals.{name}.ratio = 0 (allowed: any number but 0)"
    if not unknown:
        yield from _mistakes_in_signals([(key, signals[name]) for key, name in named], settings)


def refuses_itself(message: CarMessage) -> str:
    """Return why no frame of a message can be made, or none is taken; empty where all is well."""
    try:
        frame = message.frame(dict.fromkeys(Quantity, 0.0), 0)
        reading = message.read(frame.data)
    except Exception as error:  # of a database, of a checksum's library or of a plug-in
        why = str(error) if isinstance(error, SettingsError) else cause(error)
        return f": no frame of it can be made: {why}"
    # A message without quantities may have a multiplexer that selects nothing.
    is_refused = isinstance(reading, Refused) and reading is not Refused.UNKNOWN_MULTIPLEXER
    return f": its own frames are refused: {reading}" if is_refused else ""


def _named(settings: MessageSettings) -> list[tuple[str, str]]:
    """Return the keys that name a signal, and its name."""
    rule = settings.checksum
    return [
        *((f"signals.{name}", name) for name in settings.signals),
        *((f"constants.{name}", name) for name in settings.constants),
        *([("counter", settings.counter)] if settings.counter else ()),
        *([("checksum.signal", rule.signal)] if rule else ()),
    ]


def _mistakes_in_signals(
    named: list[tuple[str, Signal]], settings: MessageSettings
) -> Iterator[str]:
    for (key, one), (other_key, other) in combinations(named, 2):
        is_both = not (one.multiplexer_ids or other.multiplexer_ids)
        if one is other or (is_both and bits_of(one) & bits_of(other)):
            yield f".{other_key}: {other.name} has bits of {key}"
    for key, signal in named:
        if not signal.scale:
            yield f".{key}: the database gives {signal.name} the scale 0"
        elif signal.name in settings.constants:
            value = settings.constants[signal.name]
            try:
                raw_constant(signal, value)
            except ValueError as error:
                yield f".{key} = {value!r} ({error})"
        if signal.is_multiplexer and not key.startswith("constants."):
            yield f".{key}: {signal.name} is a multiplexer, which only a constant sets"
        if signal.is_float and key in ("counter", "checksum.signal"):
            yield f".{key}: {signal.name} is a float (allowed: an integer)"
    rule = settings.checksum
    if isinstance(rule, CrcRule):
        largest = (1 << named[-1][1].length) - 1
        for name in ("polynomial", "initial", "final_xor"):
            if getattr(rule, name) > largest:
                text = f"{getattr(rule, name):#x} is wider than {rule.signal}"
                yield f".checksum.{name} = {text} (allowed: up to {largest:#x})"


_LENGTHS = ", ".join(map(str, DATA_LENGTH_CODE))
