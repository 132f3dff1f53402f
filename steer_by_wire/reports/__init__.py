"""What reports share: the page, the style of the pictures, and drawings of gains.

Admission rule: it presents, knows no study and no campaign, and two programs use it, or the runs
that are started from Python do.
"""
