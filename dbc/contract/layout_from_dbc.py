"""Generator of ``generated_layout.json`` from the DBC; to be run after each change of the DBC.

python -m steer_by_wire.dbc.contract.layout_from_dbc
"""

import json
import sys
from pathlib import Path

from ..codec.codec import ContractError
from ..codec.layout import MessageLayout
from .dbc_file import layouts_of, load_database

FILE = Path(__file__).with_name("generated_layout.json")


def generated_text() -> str:
    """Return the required content of the file, a line for each signal; raises ContractError."""
    database = load_database()
    messages = ",\n".join(map(_message_text, layouts_of(database)))
    return f'{{"version": {json.dumps(database.version or "")}, "messages": [\n{messages}]}}\n'


def _message_text(layout: MessageLayout) -> str:
    head = json.dumps(layout._asdict() | {"signals": []}).removesuffix("]}")
    return head + ",".join(f"\n {json.dumps(signal)}" for signal in layout.signals) + "]}"


if __name__ == "__main__":
    try:
        FILE.write_text(generated_text(), encoding="ascii")
    except ContractError as error:
        sys.exit(str(error))
