"""The figures of the paper: computed here, and what was published.

Not here: the table, the runs and the index page (`tools.paper`). Begin at `delay_figures.py`.
"""
