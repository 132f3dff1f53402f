"""Parts of live programs: options, the host, the screen, the report and the end of a run.

Not here: parsers, signals and exit status of every program (``command_line``, ``exit_status``).
Begin at ``run_node.py``.
"""
