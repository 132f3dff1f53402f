"""Faults of frames to and from the plant: their kinds, their effects, and where they apply.

Not here: loss by the network (``network``).
Begin at ``settings.py``, whose ``FaultKind`` lists all kinds.
"""
