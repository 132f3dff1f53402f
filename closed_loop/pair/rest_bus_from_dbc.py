"""The rest bus of a pair from databases: the messages of other nodes.

Every periodic message of the databases is sent by the node that they name. Each has its cycle time,
a phase of its own and a payload whose first byte counts to 15; the other bytes and the phases are
drawn from the seed. Messages without a cycle time are not sent, nor are those whose identifier the
pair uses, and those of J1939 that need several frames. Where no message has a cycle time, as in
most databases that were found out by listening, all share the given load and are sent equally
often.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from random import Random

from ...dbc.foreign_messages import ListedMessage, read_message_set
from ...dbc.messages import CAN_IDS
from ...runtime.bus_model.rest_bus import COUNTS, PeriodicMessage
from ...runtime.bus_model.settings import BusSettings
from ...runtime.frame import EXTENDED, Frame
from ...runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import SettingsError

_EXAMPLE_PERIODS_MS = (*[10] * 4, *[20] * 4, *[50] * 3, *[100] * 4, 200, 500, 1000)
_EQUAL_CYCLE_MS = 100
"""Before the load scales it, of messages without any cycle time."""


def example_messages() -> tuple[ListedMessage, ...]:
    """Return a made-up set of messages: eighteen of 8 bytes, the urgent ones most often."""
    return tuple(
        ListedMessage(f"M{index}", 0x50 + 0x58 * index, 0, 8, period_ms, (f"ECU{index % 6}",))
        for index, period_ms in enumerate(_EXAMPLE_PERIODS_MS)
    )


def traffic_of(settings: BusSettings, seed: int) -> list[PeriodicMessage]:
    """Return the other messages on a bus; raises SettingsError for a database without any."""
    if not settings.has_traffic:
        return []
    try:
        listed = _listed(settings.rest_bus) if settings.rest_bus else example_messages()
        return rest_of(listed, seed, settings.bitrate_bit_s, settings.load)
    except ValueError as error:
        raise SettingsError(f"rest_bus: {error}") from error


@lru_cache(maxsize=8)
def _listed(files: tuple[str, ...]) -> tuple[ListedMessage, ...]:
    """Read databases, once for all runs of a study."""
    return tuple(message for file in files for message in read_message_set(Path(file)))


def rest_of(
    messages: Sequence[ListedMessage], seed: int, bitrate_bit_s: int, load: float | None = None
) -> list[PeriodicMessage]:
    """Return what is sent; with ``load``, as often as gives this share of the bus, 0 to 1.

    Raises ValueError for no messages, for no cycle times and no load, and where two messages have
    the same identifier.
    """
    others = _others(messages, has_load=load is not None)
    draw = Random(seed)  # noqa: S311 - reproducible, not secret
    nodes: dict[str, int] = {}
    sent: list[PeriodicMessage] = []
    for message in others:
        rest = draw.randbytes(max(0, message.length - 1))
        payloads = [(bytes([count]) + rest)[: message.length] for count in range(COUNTS)]
        node = nodes.setdefault((message.senders or (message.name,))[0], -1 - len(nodes))
        period_ns = round((message.cycle_ms or 0) * NS_PER_MS)
        frames = tuple(Frame(message.can_id, payload, message.flags) for payload in payloads)
        sent.append(PeriodicMessage(message.name, node, frames, period_ns))
    return sent if load is None else _scaled(sent, load, bitrate_bit_s)


def _others(messages: Sequence[ListedMessage], *, has_load: bool) -> list[ListedMessage]:
    """Return what is sent of some databases, each with a cycle time; raises as ``rest_of``."""
    own = set(CAN_IDS.values())
    known = [m for m in messages if m.fits_a_frame and (m.flags & EXTENDED or m.can_id not in own)]
    others = [m for m in known if m.cycle_ms]
    if not known:
        raise ValueError("no messages but the pair's")
    if not others and not has_load:
        raise ValueError("no message has a cycle time; with a load all are sent equally often")
    others = others or [m._replace(cycle_ms=_EQUAL_CYCLE_MS) for m in known]
    named: dict[tuple[int, int], ListedMessage] = {}
    for one in others:
        first = named.setdefault((one.can_id, one.flags & EXTENDED), one)
        if first is not one:
            raise ValueError(
                f"{first.name} and {one.name} have the same identifier 0x{one.can_id:X}; "
                "each needs its own on one bus"
            )
    return others


def _scaled(
    messages: Sequence[PeriodicMessage], load: float, bitrate_bit_s: int
) -> list[PeriodicMessage]:
    """Return them as often as gives this share of the bus."""
    faster = load_of(messages, bitrate_bit_s) / load
    return [one._replace(period_ns=max(1, round(one.period_ns * faster))) for one in messages]


def load_of(messages: Sequence[PeriodicMessage], bitrate_bit_s: int) -> float:
    """Share of the bus that the messages take, with intermissions, at the nominal rate."""
    return sum(
        (sum(frame_bits(message.frames[0])) + INTERMISSION_BITS)
        * NS_PER_S
        / (bitrate_bit_s * message.period_ns)
        for message in messages
    )
