"""Studies: what a study file means, its runs with figures and verdicts, and their files.

The program and its report are in ``tools.study``; compiled runs themselves in ``compiled``. Begin
with ``study_file``, then ``run_study``.
"""
