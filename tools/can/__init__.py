"""``steer-by-wire can``: bounds on the response times of messages.

Begin with ``__main__.py``.
"""
