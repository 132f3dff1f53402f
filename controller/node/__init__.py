"""The controller as a node: when it may steer, what it sends, and what it reports.

Not here: the command itself (``laws``). Begin with ``node``, then ``modes``.
"""
