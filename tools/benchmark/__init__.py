"""Measure what a control step and a run in virtual time cost on this machine."""
