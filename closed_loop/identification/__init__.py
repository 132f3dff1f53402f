"""Identification: a car, its steering and its network, from logs of driving.

Begin at `fit.py`; `parameters.py` says what is sought.
"""
