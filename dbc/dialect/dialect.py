"""A car's dialect, read from its file and checked against the car's database."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message

from ...runtime.node.end import End
from ...runtime.settings import SettingsError, load_settings
from ...runtime.settings.mistakes import hint
from ..foreign_messages import load_database
from ..messages import CAN_IDS, MESSAGE_TYPES, VehicleState
from .car_message import CarMessage, group_of, raw_constant
from .impossible import ambiguity, mistakes_in, refuses_itself
from .quantities import COMMANDS, SAID_BY
from .settings import DialectSettings, Quantity

_STANDARD_MAX = 0x7FF


class Dialect(NamedTuple):
    """A car's messages in the order of the file, and those of ours that are kept."""

    messages: tuple[CarMessage, ...]
    kept_ids: frozenset[int]
    database: Path

    def sent_by(self, sender: End) -> list[CarMessage]:
        """Return the messages of one end."""
        return [one for one in self.messages if one.settings.sender == sender]

    @property
    def carried(self) -> frozenset[Quantity]:
        """Every quantity that a message carries, of the car or kept of ours."""
        kept = (said for kind, said in SAID_BY.items() if CAN_IDS[kind] in self.kept_ids)
        measured = frozenset().union(*kept) - COMMANDS
        return measured.union(*(one.carries for one in self.messages))

    @property
    def missing(self) -> frozenset[str]:
        """Names of the measured quantities that no message carries; the nodes read 0."""
        wanted = {*Quantity} - COMMANDS - {Quantity.APPLYING} - self.carried
        return frozenset(one.value for one in wanted)

    @property
    def command_rate_hz(self) -> float:
        """How often the message that carries the command is sent."""
        (cycle_ms, *_) = (
            one.settings.cycle_ms for one in self.messages if Quantity.STEER in one.carries
        )
        return 1000.0 / cycle_ms

    def of_other_addresses(self, can_ids: Iterable[int]) -> list[str]:
        """Return, of foreign identifiers, those that are a message of J1939 but for the address."""
        by_group = {one.group: one for one in self.messages if one.group is not None}
        return [
            f"{can_id:08X} has the parameter group of {one.name} ({one.can_id:08X}), but another"
            f" source address: with FE in {self.database.name} any is read"
            for can_id in can_ids
            if can_id > _STANDARD_MAX and (one := by_group.get(group_of(can_id)))
        ]

    def refuse_law(self, law: str) -> None:
        """Raise SettingsError if no signal carries what a law reads but the lateral error.

        ``law``  as ``law_that_reads_the_vehicle``; an empty one is content
        """
        missing = sorted(SAID_BY[VehicleState].keys() - self.carried)
        if law and missing:
            what = f"--dialect: law {law} reads more than the lateral error"
            raise SettingsError(f"{what}, and no signal carries {', '.join(missing)}")


def read_dialect(file: Path) -> Dialect:
    """Return the dialect of a file; raises SettingsError with a line for each mistake."""
    settings = load_settings(DialectSettings, file=file)
    database = file.parent / settings.dbc
    listed = read_database(database, f"{file}: dbc")
    dialect, mistakes = checked(settings, listed, database)
    if mistakes:
        raise SettingsError(*(f"{file}: {where}{mistake}" for where, mistake in mistakes))
    return dialect


def checked(
    settings: DialectSettings, listed: Sequence[Message], database: Path
) -> tuple[Dialect, Sequence[tuple[str, str]]]:
    """Return the dialect of settings, and each mistake: its key or message's table, and what."""
    known = {message.name: message for message in listed}
    mistakes = [
        ("keep", f": {name} is no message of ours ({hint(name, MESSAGE_TYPES)})")
        for name in settings.keep
        if name not in MESSAGE_TYPES
    ]
    kept = {CAN_IDS[MESSAGE_TYPES[name]]: name for name in settings.keep if name in MESSAGE_TYPES}
    messages: list[CarMessage] = []
    for name, one in settings.messages.items():
        where = f"messages.{name}"
        message = known.get(name)
        if message is None:
            what = f": {settings.dbc} has no such message ({hint(name, known)})"
            mistakes.append((where, what))
            continue
        if why := ambiguity(message, listed):
            mistakes.append((where, f": {why}"))
            continue
        if message.frame_id in kept and not message.is_extended_frame:
            own = kept[message.frame_id]
            what = f": has the identifier {message.frame_id:#x} of {own}, which is kept"
            mistakes.append((where, what))
        found = list(mistakes_in(message, one))
        if not found:
            constants = {
                key: raw_constant(message.get_signal_by_name(key), value)
                for key, value in one.constants.items()
            }
            made = CarMessage(message, one, constants)
            identity = made.can_id, made.flags
            same = [it.name for it in messages if (it.can_id, it.flags) == identity]
            found += [f": has the identifier {made.can_id:#x} of {other}" for other in same]
            found += [why] if (why := refuses_itself(made)) else []
            messages.append(made)
        mistakes += [(where, mistake) for mistake in found]
    dialect = Dialect(tuple(messages), frozenset(kept), database)
    if not mistakes and Quantity.STEER not in dialect.carried:
        mistakes.append(("messages", ": no signal carries steer_rad, so no one can steer"))
    return dialect, mistakes


def read_database(file: Path, where: str) -> Sequence[Message]:
    """Return the messages of a database; raises SettingsError."""
    try:
        return load_database(file).messages
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from error
