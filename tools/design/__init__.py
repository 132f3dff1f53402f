"""The program ``design``: gains and filters of the laws for a vehicle known within bounds.

What D-stable means is in ``closed_loop.parameter_space``; the laws themselves are in
``controller.laws``. Begin with ``law_design``; the comparison of structures is in ``frontier``.
"""
