"""The settings of a stored run, from nothing but what its folder holds."""

import json
from collections.abc import Mapping
from typing import Any

from steer_by_wire.closed_loop.studies.scenario import Pair, laid_over
from steer_by_wire.dbc.bus_language import read_language
from steer_by_wire.plant_emulator.faults.messages_on_bus import naming


def pair_of_row(record: Mapping[str, Any], row: Mapping[str, Any]) -> Pair:
    """Return the settings of a stored run from what its folder holds alone.

    ``record``  study.json
    ``row``     of the results
    """
    overrides, name = json.loads(row["overrides"]), row["controller"]
    given = {"plant": record["plant"], "controller": record["controllers"][name]}
    given |= {"bus": record["bus"]} if record["bus"] else {}
    command = record["base"]["variants"].get(name, {}).get("command", ())
    dialect = record["dialect"]
    tables = {**laid_over(given, overrides), "command": command, "dialect": dialect}
    text = json.dumps(tables)
    return Pair.model_validate_json(text, strict=True, context=naming(read_language(dialect)))
