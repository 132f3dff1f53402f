"""Real processes on an emulated bus: the live campaign, and the soak with a babbling node.

Virtual time is in ``campaign``, what is injected in ``injection``. Begin with ``live_run.py``, the
one way in which a run is started and ended.
"""
