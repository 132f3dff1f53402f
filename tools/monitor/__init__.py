"""The monitor: from frames to a view, from a view to lines of text, and what its keys do."""
