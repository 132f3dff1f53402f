"""A controller as C99: ``steer-by-wire generate-c``.

Begin with ``law_source``, which says which functions of Python become C; ``functions`` translates
one. ``node`` has the C by hand around them, ``node_source`` what it is given.
"""
