"""Stress studies: the meaning of a study file, its runs, figures and verdicts, and their storage.

Admission rule: both the program that runs studies and the one that reports on them use it.
"""
