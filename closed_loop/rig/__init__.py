"""Drives a plant with any controller: starts both, keeps their files, and judges the run.

Admission rule: what a test of somebody's controller needs, with or without pytest.
"""

from .outcome import Outcome
from .rig import Rig

__all__ = ["Outcome", "Rig"]
