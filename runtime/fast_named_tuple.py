"""A fast constructor of NamedTuples, for records of every frame or tick.

A NamedTuple's own constructor is a Python call, 0.4 % of a tick. The records made here in every
frame and tick are together 3 % (instructions by callgrind). mypy does not check the types, so
other records are made plainly.
"""

new_record = tuple.__new__
"""``new_record(NamedTupleType, (first, second, ...))``"""
