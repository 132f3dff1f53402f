"""Parts of reports: the HTML page, the style of pictures, progress in the terminal.

Not here: any figure, which each report computes itself. Begin at `page.py`.
"""
