"""A fast constructor of NamedTuples, for records of every frame or tick.

A NamedTuple's own constructor is a Python function and takes three times as long. All fields are
given, by position, and mypy does not check their types.
"""

new_record = tuple.__new__
"""``new_record(NamedTupleType, (first, second, ...))``"""
