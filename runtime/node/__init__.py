"""Node interface, and the executors that run nodes in virtual and in real time.

Not here: what a program needs beyond its node, such as options and signals (``program``).
Begin at ``node.py``, whose names this package hands on.
"""

from .node import (
    NEVER_NS,
    NS_PER_MS,
    NS_PER_S,
    NS_PER_US,
    N,
    Node,
    ReportingNode,
    View,
    Wrapper,
    innermost,
)

__all__ = [
    "NEVER_NS",
    "NS_PER_MS",
    "NS_PER_S",
    "NS_PER_US",
    "N",
    "Node",
    "ReportingNode",
    "View",
    "Wrapper",
    "innermost",
]
