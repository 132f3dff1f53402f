"""Settings of any program: from TOML to frozen models, and every mistake in one line.

Not here: the tables themselves, which stand with their subjects.
Begin at ``settings.py``, whose names this package hands on.
"""

from .settings import (
    COMMAND_LINE,
    NUMBER_OR_WORD,
    OffWord,
    Preset,
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    preset_names,
    preset_title,
    read_preset,
    read_table,
    read_text,
    with_values,
)

__all__ = [
    "COMMAND_LINE",
    "NUMBER_OR_WORD",
    "OffWord",
    "Preset",
    "Settings",
    "SettingsError",
    "SharedTable",
    "load_settings",
    "preset_names",
    "preset_title",
    "read_preset",
    "read_table",
    "read_text",
    "with_values",
]
