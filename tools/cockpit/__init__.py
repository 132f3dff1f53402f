"""Watch and drive the loop in a browser."""
