"""The plant as a node, its sensors and its supervision of itself; begin at `node.py`."""
