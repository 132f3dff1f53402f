"""Watch and drive the loop in a browser.

Not here: the pages that other programs write (``closed_loop.reports``). Begin with
``page_requests.py``, which takes the visitor's commands. A lane is one plant with its controller
(``lane.py``).
"""
