"""Analyse a recording or a candump log: signals, latencies, losses."""
