"""A frame as candump shows it, and its message in words."""

from collections.abc import Mapping
from enum import IntEnum

from ...dbc.generated_layout import LAYOUTS
from ...dbc.layout import SignalLayout
from ...dbc.messages import MESSAGE_TYPES, Message
from ...runtime.frame import Frame

_SIGNALS: Mapping[type[Message], Mapping[str, SignalLayout]] = {
    MESSAGE_TYPES[layout.name]: {signal.field: signal for signal in layout.signals}
    for layout in LAYOUTS
}
_DIGITS_MAX = 9


def payload_text(frame: Frame) -> str:
    """Return length and bytes, as in ``[3]  01 02 03``."""
    return f"[{len(frame.data)}]  {frame.data.hex(' ').upper()}"


def message_text(message: Message) -> str:
    """Return every signal with its value and unit."""
    signals = _SIGNALS[type(message)]
    return ", ".join(
        _signal_text(signals[field], value) for field, value in message._asdict().items()
    )


def _signal_text(signal: SignalLayout, value: float) -> str:
    if isinstance(value, IntEnum):
        return f"{signal.name} {value.name}"
    text = f"{value:.{_digits(signal.scale)}f}"
    return f"{signal.name} {text} {signal.unit}".rstrip()


def _digits(scale: float) -> int:
    return next(n for n in range(_DIGITS_MAX + 1) if round(scale, n) == scale or n == _DIGITS_MAX)
