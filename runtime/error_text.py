"""The text of an error as one line."""


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, its type where it has no text."""
    return " ".join(str(error).split()) or type(error).__name__
