"""The program ``study``: runs a study file and writes its report, one section a file.

What a study is, and its results, are in ``closed_loop.studies``. Begin with ``__main__`` for the
command, with ``report`` for the page.
"""
