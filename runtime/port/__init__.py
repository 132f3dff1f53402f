"""A node's access to a bus, whatever the bus.

Not here: the interface to the emulated bus, which python-can opens as any other.
Begin at ``port.py``.
"""
