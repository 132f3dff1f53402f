"""Faults on a live bus: a babbling node, and the kinds a frame can suffer.

Admission rule: it disturbs a bus, and two programs use it.
"""
