"""Soak: the pair on a bus that a babbling node keeps full, for minutes, and what it came to."""
