"""A controller as C99: ``steer-by-wire generate-c``.

Begin with ``law_source`` and ``node_source``, which say which functions of Python become C;
``functions`` translates one. ``node`` has the C that is written by hand around them.
"""
