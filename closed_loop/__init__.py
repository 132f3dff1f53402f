"""Connects the two nodes: in virtual time, or as processes on a bus.

Admission rule: it starts or joins plant emulator and controller, and two programs use it.
"""
