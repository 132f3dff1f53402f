"""The campaign in virtual time: its specification, each run and its judgement, the results.

Nothing here waits for a clock or starts a program; real processes are in ``live``. Begin with
``trial.py``: one run and what was detected.
"""
