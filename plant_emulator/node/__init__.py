"""The plant as a node on the bus: the one place where its rooms meet.

Not here: what each room decides, such as the steering's limits or the sensors' noise.
Begin at ``node.py``.
"""
