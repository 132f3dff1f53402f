"""A node's access to a bus, whatever the bus; begin at `port.py`."""
