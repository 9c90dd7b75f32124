"""Foreign text in a line of a terminal or log."""

from tca_wire.vocabulary import Limit


def printable(text: str) -> str:
    """*text* without characters that would steer a terminal: those are written as escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """*text* made printable line by line."""
    return "\n".join(map(printable, text.splitlines()))


def first_line(text: str) -> str:
    """The first line; of more, such as a traceback, there is a "..."."""
    first, *rest = text.strip().splitlines() or [""]
    return first + (" ..." if any(map(str.strip, rest)) else "")


def shortened(text: str, longest: int = int(Limit.TEXT)) -> str:
    """A text's beginning and end, if it is too long for all of it."""
    half = (longest - 1) // 2
    return text if len(text) <= longest else f"{text[:half]}…{text[-half:]}"
