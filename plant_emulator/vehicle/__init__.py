"""The moving vehicle: actuator, single-track model, disturbances, and their exact propagation."""
