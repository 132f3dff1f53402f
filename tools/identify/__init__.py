"""Program ``steer-by-wire identify``: a car, its steering and its network from logs."""
