"""What the sensors report: their noise, their messages, the path ahead."""
