"""Analyse a recording or candump's log."""
