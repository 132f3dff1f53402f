"""Programs and workers: how they are started, watched and ended, and where they may write.

Not here: what a plant and a controller do together (`closed_loop`). Begin at `process_group.py`.
"""
