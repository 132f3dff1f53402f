"""Hand wheel: what the driver holds, and the torque that the road sends back over the bus.

Begin with ``node.py``. The analysis of the feedback loop, which round trip of the bus makes the
wheel shake, is ``wheel_alone`` and ``sampled_loop``.
"""
