"""A node on a car's own bus: its messages, from the user's database, translated at the node's edge.

Not here: the vehicle itself (``plant_emulator.vehicle``). Begin with ``settings.py``, the file of a
car; ``gateway.py`` stands before a node.
"""
