"""Settings of any program: from TOML to frozen models, and every mistake in one line.

Not here: the tables themselves, which stand with their subjects.
Begin at ``settings.py``, whose names this package hands on.
"""

from .settings import COMMAND_LINE as COMMAND_LINE
from .settings import NUMBER_OR_WORD as NUMBER_OR_WORD
from .settings import OffWord as OffWord
from .settings import Preset as Preset
from .settings import Settings as Settings
from .settings import SettingsError as SettingsError
from .settings import SharedTable as SharedTable
from .settings import load_settings as load_settings
from .settings import preset_names as preset_names
from .settings import preset_title as preset_title
from .settings import read_preset as read_preset
from .settings import read_table as read_table
from .settings import read_text as read_text
from .settings import with_values as with_values
