"""The path to follow: curvature over arc length, its shapes, and how far a vehicle is from it.

Not here: the vehicle that follows it (``vehicle``), and PATH_AHEAD on the bus (``sensors``).
Begin at ``path.py``.
"""
