"""Emulated CAN bus: a broker process and a python-can interface, with bit-true frame timing."""
