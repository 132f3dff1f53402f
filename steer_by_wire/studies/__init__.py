"""Stress studies: what a study file means, its runs, figures and verdicts, and how they are kept.

Admission rule: both the program that runs studies and the one that reports on them use it.
"""
