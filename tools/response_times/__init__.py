"""Bound the response time of every message on a bus, and what it means for the steering."""
