"""Mistakes in the file of a dialect: what it asks of a message and the database rules out."""

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import chain, combinations, product

from cantools.database.can import Message, Signal

from ...runtime.frame import CLASSIC_LENGTH_MAX
from ...runtime.frame.length_with_stuff_bits import padded_length
from ...runtime.node.end import End
from ...runtime.settings import SettingsError
from ...runtime.settings.mistakes import hint
from ...runtime.settings.plugin import cause
from .car_message import LARGEST_FLOATS, CarMessage, Refused, bits_of, raw_constant, share_bits
from .checksum import CrcRule
from .quantities import COMMANDS
from .settings import MessageSettings, Quantity


def mistakes_in(message: Message, settings: MessageSettings) -> Iterator[str]:
    """Yield each mistake, beginning with its key in the message's table."""
    signals = {signal.name: signal for signal in message.signals}
    named = _named(settings)
    impossible = [
        *(
            f".{key}: {message.name} has no signal {name} ({hint(name, signals)})"
            for key, name in named
            if name not in signals
        ),
        *(
            f": {name} is a float of {signal.length} bits (allowed: {_FLOATS})"
            for name, signal in signals.items()
            if signal.is_float and signal.length not in LARGEST_FLOATS
        ),
    ]
    yield from impossible
    if padded_length(message.length) is None:
        yield f": {message.length} bytes do not fit into a frame (allowed: up to 64)"
    elif message.protocol == "j1939" and not message.is_fd and message.length > CLASSIC_LENGTH_MAX:
        yield f": {message.length} bytes of J1939 are several frames (allowed: up to 8)"
    for signal in message.signals:
        if max(bits_of(signal)) >= 8 * message.length:
            yield f": signal {signal.name} ends beyond its {message.length} bytes"
    for name, one in settings.signals.items():
        if (one.carries in COMMANDS) != (settings.sender == End.CONTROLLER):
            other = End.CONTROLLER if one.carries in COMMANDS else End.PLANT
            yield f".signals.{name}: {one.carries} is sent by the {other}"
        if not one.ratio:
            yield f".signals.{name}.ratio = 0 (allowed: any number but 0)"
    if not impossible:
        found = [(key, signals[name]) for key, name in named]
        yield from _shared_bits(message, found)
        yield from _mistakes_in_signals(found, settings)


def ambiguity(message: Message, messages: Iterable[Message]) -> str:
    """Return why names say too little of a message of the database; empty where they are enough."""
    same = [f"{one.frame_id:#x}" for one in messages if one.name == message.name]
    if len(same) > 1:
        return f"{len(same)} messages of the database have this name: {', '.join(same)}"
    counts = Counter(signal.name for signal in message.signals)
    twice = [name for name, count in counts.items() if count > 1]
    what = "signals of the database have one name, under several values of a multiplexer"
    return f"{what}: {', '.join(twice)}" if twice else ""


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
    rule = settings.checksum
    return [
        *((f"signals.{name}", name) for name in settings.signals),
        *((f"constants.{name}", name) for name in settings.constants),
        *([("counter", settings.counter)] if settings.counter else ()),
        *([("checksum.signal", rule.signal)] if rule else ()),
    ]


def _shared_bits(message: Message, named: list[tuple[str, Signal]]) -> Iterator[str]:
    known = {signal.name for _, signal in named}
    selecting = [
        (f"multiplexer {one.name}", one)
        for one in message.signals
        if one.is_multiplexer and one.name not in known
    ]
    for (key, one), (other_key, other) in chain(combinations(named, 2), product(selecting, named)):
        if share_bits(message, one, other):
            yield f".{other_key}: {other.name} has bits of {key}"


def _mistakes_in_signals(
    named: list[tuple[str, Signal]], settings: MessageSettings
) -> Iterator[str]:
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
        if key in ("counter", "checksum.signal"):
            if signal.is_float:
                yield f".{key}: {signal.name} is a float (allowed: an integer)"
            if signal.multiplexer_ids:
                yield f".{key}: {signal.name} is multiplexed (allowed: a signal of every frame)"
    rule = settings.checksum
    if isinstance(rule, CrcRule):
        largest = (1 << named[-1][1].length) - 1
        for name in ("polynomial", "initial", "final_xor"):
            if getattr(rule, name) > largest:
                text = f"{getattr(rule, name):#x} is wider than {rule.signal}"
                yield f".checksum.{name} = {text} (allowed: up to {largest:#x})"


_FLOATS = ", ".join(map(str, LARGEST_FLOATS))
