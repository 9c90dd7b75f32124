"""Untrusted text, made safe for a line of a terminal or log."""

from tca_wire.vocabulary import Limit


def printable(text: str) -> str:
    """Return *text* with escapes for characters that would control a terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """Return *text* made printable line by line."""
    return "\n".join(map(printable, text.splitlines()))


def first_line(text: str) -> str:
    """Return the first line, with " ..." if there are more, as in a traceback."""
    first, *rest = text.strip().splitlines() or [""]
    return first + (" ..." if any(map(str.strip, rest)) else "")


def shortened(text: str, longest: int = int(Limit.TEXT)) -> str:
    """Return *text* if it is short enough, otherwise its start and end."""
    half = (longest - 1) // 2
    return text if len(text) <= longest else f"{text[:half]}…{text[-half:]}"
