"""Errors of the daemon.

RequestError    a module's request cannot be done: it is refused and leaves no trace.
CentralError    central cannot start or continue: the address is in use, for example.
DiskFull        central can start or continue as soon as the disk has room.
ImageError      the state cannot be written as an image, or an image cannot be read.
"""

import errno

from tca_wire.vocabulary import Limit, Refusal, is_name


class RequestError(Exception):
    """A module's request cannot be done.

    It is raised before anything has changed, or after everything was undone.
    """

    def __init__(self, refusal: Refusal, text: str) -> None:
        super().__init__(refusal, text)
        self.refusal = refusal
        self.text = text

    def __str__(self) -> str:
        return self.text


def check_name(kind: str, name: str, *, or_none: bool = False) -> None:
    """Raise RequestError if a name for a *kind* is too long, or would control a terminal.

    With *or_none* the name may be empty.
    """
    if not is_name(name) and not (or_none and not name):
        text = f"{name!r:.60} names no {kind}: give 1 to {Limit.NAME:d} printable characters"
        raise RequestError(Refusal.PROTOCOL, text)


class CentralError(Exception):
    """Central cannot start or continue. The text says what, which and what to do."""


class DiskFull(CentralError):
    """Central can start, or continue, as soon as the disk has room."""


def disk_error(
    error: OSError, text: str, advice: str = "name another folder with --journal"
) -> CentralError:
    """Return the error for a failed operation on the disk.

    *advice* is added unless the disk is full.
    """
    text = f"{text}: {error.strerror}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return DiskFull(f"{text}: make room, then start central again")
    return CentralError(f"{text}: {advice}")


class ImageError(CentralError):
    """An image of central's state cannot be made or used."""
