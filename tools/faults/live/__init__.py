"""Real processes on an emulated bus: the live campaign.

Virtual time is in ``campaign``, what is injected in ``injection``. Begin with ``recorded_pair.py``,
the one way in which a run is started and ended.
"""
