"""Sensors: which frame they send at which sample, with which noise, and the path ahead.

Not here: the motion that they sample (``vehicle``), and the latency of the frames (``network``).
Begin at ``sampling.py``.
"""
