"""Compiled runs: the same step functions as the nodes, bit for bit, thousands of runs a second.

Admission rule: it is compiled, or lays out what compiled code reads or leaves.
"""
