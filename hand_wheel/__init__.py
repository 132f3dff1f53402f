"""Hand wheel: what the driver holds, and the torque that the road sends back over the bus.

Here is the analysis of the feedback loop: which round trip of the bus makes the wheel shake. Begin
with ``wheel_alone``, then ``sampled_loop``.
"""
