"""Inject faults by magnitude, operating point, law and direction, and judge each run."""
