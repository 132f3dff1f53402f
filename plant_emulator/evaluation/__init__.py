"""Record of a run, the verdict on it, and the report in JSON and in words.

Not here: what is shown while the plant runs (``node.node``).
Begin at ``run_record.py``; ``run_verdict.py`` decides whether the path was held.
"""
