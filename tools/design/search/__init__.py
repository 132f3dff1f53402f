"""The search for a law's parameters: what varies, the evolution, the confirmation of its best.

Not here: the demands that a law is judged by (`../demands.py`). Begin at `parameter_search.py`.
"""
