"""One CAN frame: as the nodes see it (`frame.py`), its bits, its length, its reception."""
