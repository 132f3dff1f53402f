"""Node interface, and the executors that run nodes in virtual and in real time.

Not here: what a program needs beyond its node, such as options and signals (``program``).
Begin at ``node.py``, whose names this package hands on.
"""

from .node import NEVER_NS as NEVER_NS
from .node import NS_PER_MS as NS_PER_MS
from .node import NS_PER_S as NS_PER_S
from .node import NS_PER_US as NS_PER_US
from .node import N as N
from .node import Node as Node
from .node import ReportingNode as ReportingNode
from .node import View as View
from .node import Wrapper as Wrapper
from .node import innermost as innermost
