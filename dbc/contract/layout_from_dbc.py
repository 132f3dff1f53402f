"""Writes ``generated_layout.py`` from the DBC; to be run after each change of the DBC.

python -m steer_by_wire.dbc.contract.layout_from_dbc
"""

import sys
from pathlib import Path
from textwrap import fill

from ..codec.codec import ContractError
from ..codec.layout import MessageLayout, SignalLayout
from .dbc_file import layouts_of, load_database

FILE = Path(__file__).with_name("generated_layout.py")

_HEAD = '''"""The messages of ``steer_by_wire.dbc``; written by ``contract.layout_from_dbc``."""

from ..codec.layout import MessageLayout, SignalLayout

# fmt: off


def _signals(*rows: tuple[object, ...]) -> tuple[SignalLayout, ...]:
    """Rows: name, field, start, length, is_signed, scale, minimum, maximum, unit, not_available."""
    return tuple(map(SignalLayout._make, rows))


VERSION = "{version}"

LAYOUTS: tuple[MessageLayout, ...] = (
'''


def generated_text() -> str:
    """Return the required content of the file; raises ContractError."""
    database = load_database()
    head = _HEAD.replace("{version}", database.version or "")
    return head + "".join(map(_message_text, layouts_of(database))) + ")\n"


def _message_text(layout: MessageLayout) -> str:
    data_id = None if layout.data_id is None else f"{layout.data_id:#06x}"
    return (
        f'    MessageLayout("{layout.name}", sender="{layout.sender}",\n'
        f"        can_id={layout.can_id:#05x}, length={layout.length},"
        f" cycle_time_ms={layout.cycle_time_ms},"
        f" active_cycle_time_ms={layout.active_cycle_time_ms}, data_id={data_id},\n"
        "        signals=_signals(\n" + "".join(map(_signal_text, layout.signals)) + "    )),\n"
    )


def _signal_text(layout: SignalLayout) -> str:
    row = f"{tuple(layout)},".replace("'", '"')
    return fill(row, 100, initial_indent=" " * 8, subsequent_indent=" " * 9) + "\n"


if __name__ == "__main__":
    try:
        FILE.write_text(generated_text(), encoding="ascii")
    except ContractError as error:
        sys.exit(str(error))
