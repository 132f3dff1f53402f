"""Program ``steer-by-wire feedback``: the stable round trips of force feedback."""
