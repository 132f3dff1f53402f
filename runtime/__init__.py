"""Run-time parts that all programs share: nodes, time, executors, buses, recording.

Both programs run everything in this package, and nothing in it names vehicle or controller.
Begin at ``node/node.py``.
"""
