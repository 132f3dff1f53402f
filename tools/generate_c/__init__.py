"""C99 from the very step functions that run in Python: ``steer-by-wire generate-c``.

Begin with ``law_source``, which says which functions become C; ``functions`` translates one.
"""
