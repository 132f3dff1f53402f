"""The rig: vehicle, actuator, path, disturbances, latency lines, node and program."""
