"""Programs around the two nodes: demo, closed-loop runs, benchmarks."""
