"""What reports share: one page, one plot style.

Admission rule: it presents, knows no study and no campaign, and two programs use it.
"""
