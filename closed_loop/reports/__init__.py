"""What reports share: the page, the style of the pictures, and drawings of gains.

Admission rule: it presents results, knows no study and no campaign, and is used by two programs or
by runs that are started from Python.
"""
