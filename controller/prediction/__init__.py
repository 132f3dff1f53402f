"""Kalman filter, its gains, and the prediction to the time at which a command acts."""
