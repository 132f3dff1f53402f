"""Compiled runs: the step functions of the nodes, bit for bit, thousands of runs a second.

Not here: any arithmetic of its own, which stands in the steps. Begin at `engine.py`.
"""
