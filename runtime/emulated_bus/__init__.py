"""Emulated CAN bus: a broker process and a python-can interface, with bit-true frame timing.

Not here: when a frame wins the bus (``bus_model``), and the broker as a program (``tools/bus``).
Begin at ``broker.py``; a client's side is ``interface.py``.
"""
