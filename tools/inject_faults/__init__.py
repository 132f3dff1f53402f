"""Faults on a live bus and of live processes: what they send or do, when, and what was done."""
