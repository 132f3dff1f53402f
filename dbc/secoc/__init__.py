"""Authenticated frames (SecOC): key, frame, and a node behind both; nobody else needs them."""
