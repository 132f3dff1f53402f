"""The frontier: the least error of each structure of a law for each delay that it guarantees.

Not here: the search itself and what it judges by (``tools.design``).
Begin at ``frontier.py``, which computes all structures in worker processes.
"""
