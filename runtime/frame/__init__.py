"""One CAN frame: as the nodes see it, and its length on the wire.

Not here: who may send when (``bus_model``), and how a program gets at a bus (``port``).
Begin at ``frame.py``, whose names this package hands on.
"""

from .frame import BITRATE_SWITCH as BITRATE_SWITCH
from .frame import CLASSIC_LENGTH_MAX as CLASSIC_LENGTH_MAX
from .frame import ERROR as ERROR
from .frame import EXTENDED as EXTENDED
from .frame import FD as FD
from .frame import REMOTE as REMOTE
from .frame import Frame as Frame
