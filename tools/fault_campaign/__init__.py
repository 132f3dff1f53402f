"""The fault campaign: faults by magnitude, operating point, law and direction, and their judge."""
