"""A CAN bus as a model: who sends when, and what noise destroys.

Not here: a frame's bits and length (``frame``), and buses between processes (``emulated_bus``).
Begin at ``bus_model.py``.
"""
