"""Faults of frames to and from the plant: what they are, and the stage that applies them."""
