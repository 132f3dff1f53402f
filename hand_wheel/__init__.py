"""Hand wheel: what the driver holds, and the torque that the road sends back over the bus.

Begin with ``node.py``; ``analysis`` says at which round trip of the bus the wheel shakes.
"""
