"""Measure how late this machine wakes a real-time program, and its bus."""
