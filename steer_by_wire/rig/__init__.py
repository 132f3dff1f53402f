"""A plant under test with any controller: starts both, keeps what they leave, judges it.

Admission rule: what a test of somebody's controller needs, with or without pytest.
"""

from .outcome import Outcome
from .rig import Rig

__all__ = ["Outcome", "Rig"]
