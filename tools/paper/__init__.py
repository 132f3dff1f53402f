"""``steer-by-wire paper``: the figures and tables of SAE 2018-01-1086, published and reproduced.

What design uses too is in ``closed_loop/parameter_space``. Begin with ``__main__.py``.
"""
