"""Measures what a machine does to a real-time program: how late it wakes it up, and its bus."""
