"""The controller as a node, where reception, modes, law and safety meet; begin at `node.py`."""
