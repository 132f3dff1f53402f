"""The rig: a plant in a test's hands, to be driven by any controller; it keeps and judges each run.

Not here: the fixtures for pytest (`pytest_plugin.py`). Begin at `rig.py`.
"""

from .outcome_and_assertions import Outcome
from .rig import Rig

__all__ = ["Outcome", "Rig"]
