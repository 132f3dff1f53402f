"""A CAN bus as a model: who sends when, and what noise destroys; begin at `bus_model.py`."""
