"""Makes a NamedTuple of all its fields at once, where it is made for every frame or every tick.

A NamedTuple's own constructor is a Python function, and takes three times as long. Fields are given
by position, none may be left out, and the types are not checked.
"""

new_record = tuple.__new__
"""``new_record(NamedTupleType, (first, second, ...))``"""
