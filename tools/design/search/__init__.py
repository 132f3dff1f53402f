"""The search for a law's parameters: what varies, the evolution, the descent, stop and resume.

Not here: the demands that a law is judged by (`../demands.py`). Begin at `parameter_search.py`.
"""
