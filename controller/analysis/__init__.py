"""Design-time analysis of the loop, for ``--check`` and the tools: delays and jitter it tolerates.

Not here: anything that a running node imports. Begin with ``check_figures``.
"""
