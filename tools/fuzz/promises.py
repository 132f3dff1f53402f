"""The exception of a target when the project breaks a promise."""


class BrokenPromiseError(AssertionError):
    """Something happened that must not, whatever the input."""


def promise(holds: bool, otherwise: str) -> None:
    """Raise BrokenPromiseError unless ``holds``."""
    if not holds:
        raise BrokenPromiseError(otherwise)
