"""Why something failed, on one line."""


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, its type where it has no text."""
    return " ".join(str(error).split()) or type(error).__name__


def cause_of(error: BaseException) -> str:
    """Return what the system says of an error code, otherwise the error's text, on one line."""
    return (error.strerror if isinstance(error, OSError) else None) or one_line(error)
