"""``steer-by-wire can``: frames bit by bit, and bounds on the response times of messages.

The bits themselves are in ``runtime/frame/wire_bits.py``. Begin with ``__main__.py``.
"""
