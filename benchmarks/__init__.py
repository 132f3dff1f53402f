"""What the programs cost on this machine, measured in a checkout; no user needs it.

Which rate a machine keeps is told by ``steer-by-wire doctor``. Begin with ``__main__.py``.
"""
