"""What a log of the bus tells: signals, latency, cycle times, frames lost and refused."""
