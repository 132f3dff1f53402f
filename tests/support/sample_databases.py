"""Other people's databases as the traffic beside the pair: which run, and why the others do not.

    git clone https://github.com/commaai/opendbc
    python -m tests.support.sample_databases opendbc/opendbc/dbc

Runs the pair for a second of virtual time beside each database (*.dbc) below the folders, at half
of the bus, and counts what became of them. Files that do not run are listed with the reason.
"""
# ruff: noqa: T201 it reports to whoever starts it

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from steer_by_wire.closed_loop.virtual_bus import shared_bus
from steer_by_wire.closed_loop.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.foreign_messages import read_message_set
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset

LOAD = 0.5


class Tried(NamedTuple):
    """What became of one database.

    ``outcome``  "runs", "runs, equally often" without cycle times, "refused"
    ``reason``   of a refusal
    ``busy``     share of the time that the bus was busy with these messages and the pair's
    """

    file: Path
    outcome: str
    reason: str = ""
    messages: int = 0
    busy: float = 0.0


def try_database(file: Path) -> Tried:
    """Run the pair beside the messages of a database."""
    settings = BusSettings(rest_bus=(str(file),), load=LOAD)
    try:
        bus = shared_bus(settings, 1)
    except SettingsError as error:
        return Tried(file, "refused", str(error))
    plant = read_preset("steer_by_wire.plant_emulator.presets", "paper_nominal")
    controller = read_preset("steer_by_wire.controller.presets", "practical_pd")
    pair = make_virtual_pair(
        load_settings(PlantSettings, plant, None, ["duration_s=1.0"]),
        load_settings(ControllerSettings, controller),
    )
    run_virtual_nodes(pair.edge, pair.controller, bus, None, lambda: False)
    messages = read_message_set(file)
    has_cycles = any(message.cycle_ms for message in messages)
    busy = bus.model.load.busy_ns / 1e9
    outcome = "runs" if has_cycles else "runs, equally often"
    return Tried(file, outcome, messages=len(messages), busy=busy)


def try_all(folders: Sequence[Path]) -> Iterator[Tried]:
    """Try every database below some folders."""
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            if file.suffix.lower() == ".dbc":
                yield try_database(file)


def main(folders: Sequence[str]) -> None:
    """Try them and print what became of them."""
    counts: Counter[str] = Counter()
    messages = 0
    for tried in try_all([Path(folder) for folder in folders]):
        counts[tried.outcome] += 1
        messages += tried.messages
        if tried.reason:
            print(f"{tried.file.name}: {tried.reason.removeprefix('rest_bus: ')}")
        elif not LOAD < tried.busy < LOAD + 0.2:
            print(f"{tried.file}: the bus was busy {tried.busy:.0%} of the time")
    print(", ".join(f"{count} {outcome}" for outcome, count in sorted(counts.items())))
    print(f"{messages} messages sent")


if __name__ == "__main__":
    main(sys.argv[1:])
