"""Latency and loss between the nodes: distributions, draws, and the two lines that delay frames.

Not here: the bus with its arbitration (``runtime.bus_model``), and injected faults (``faults``).
Begin at ``network.py``.
"""
