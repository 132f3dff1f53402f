"""The text of errors in messages of one line."""


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, its type where it has no text."""
    return " ".join(str(error).split()) or type(error).__name__
