"""The path to follow: curvature over arc length, its shapes, and the deviation from it."""
