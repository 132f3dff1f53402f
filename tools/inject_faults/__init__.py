"""Inject faults into a live bus or live processes, and record what was done."""
