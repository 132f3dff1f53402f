"""All that stands between a command and the wheel: buffer, guard, limiter, unit."""
