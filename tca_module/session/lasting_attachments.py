"""The exception handlers and wiretaps that a program has attached to messages and to the root.

They are attached again at a restarted central. All connections of a program share one list, which
several threads use.
"""

import threading
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from tca_module.session.epoch_numbers import EpochNumber
from tca_wire.packets.headers import Attach, Tap
from tca_wire.packets.parts import MessageFormat
from tca_wire.points import ROOT


class LastingAttachment:
    """An exception handler or wiretap that was attached."""

    __slots__ = ("formats", "header", "number")

    def __init__(
        self, header: Attach | Tap, formats: list[MessageFormat], number: EpochNumber
    ) -> None:
        self.header = header  #: the request that attached it
        self.formats = formats  #: formats of the messages that it names
        self.number = number  #: the id under which a central knows it

    def __str__(self) -> str:
        header = self.header
        if isinstance(header, Tap):
            return f"wiretap '{header.condition}' of '{header.message}' with '{header.listener}'"
        where = f"all '{header.message}'" if header.message else "the root"
        return f"exception handler '{header.attachment.handler}' of {where}"


def is_lasting(header: Any) -> bool:
    """Return whether a request attaches something to a message or to the root.

    An attachment to a task does not last: it ends with the task.
    """
    if isinstance(header, Attach):
        return bool(header.message) or header.task == ROOT
    return isinstance(header, Tap) and bool(header.message)


class LastingAttachments:
    """The wanted attachments, in the order in which they were attached."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wanted: dict[tuple[Any, ...], LastingAttachment] = {}
        #: removed attachments of a central that the removing connection did not know yet
        self.unwanted: list[LastingAttachment] = []

    def add(
        self, header: Attach | Tap, known: dict[str, MessageFormat], number: EpochNumber
    ) -> None:
        """Add an attachment that central has accepted.

        A wiretap that is attached again unchanged keeps its place in the order. Any other
        attachment that replaces an earlier one becomes the newest.
        """
        header, key = msgspec.structs.replace(header, number=0, origin=0), _key(header)
        with self._lock:
            previous = self._wanted.get(key)
            if previous is not None and isinstance(header, Tap) and previous.header == header:
                previous.number = number
                return
            self._wanted.pop(key, None)
            name = header.listener if isinstance(header, Tap) else header.attachment.handler
            named = [known[each] for each in (name, header.message) if each in known]
            self._wanted[key] = LastingAttachment(header, [*_with_needed(named, known)], number)

    def find(self, header: Attach | Tap) -> LastingAttachment | None:
        """Return the attachment made by a request; None for one to a task, or a removed one."""
        with self._lock:
            return self._wanted.get(_key(header)) if is_lasting(header) else None

    def unknown_to(self, epoch: str) -> list[LastingAttachment]:
        """Return the attachments to make at the central of that epoch, oldest first.

        These are the oldest attachment that central lacks and all newer ones, so that their order
        at central stays the same.
        """
        with self._lock:
            wanted = list(self._wanted.values())
        first = next((i for i, one in enumerate(wanted) if one.number.epoch != epoch), len(wanted))
        return wanted[first:]

    def is_wanted(self, attachment: LastingAttachment) -> bool:
        """Return whether an attachment has not been removed or replaced."""
        with self._lock:
            return self._wanted.get(_key(attachment.header)) is attachment

    def forget(self, attachment: LastingAttachment, epoch: str) -> None:
        """Remove an attachment. *epoch*: that of the central that the caller's connection knows."""
        with self._lock:
            key = _key(attachment.header)
            if self._wanted.get(key) is attachment:
                del self._wanted[key]
            if attachment.number.epoch != epoch:
                self.unwanted.append(attachment)

    def pop_unwanted(self, epoch: str) -> list[LastingAttachment]:
        """Remove and return the unwanted attachments of the central of that epoch."""
        with self._lock:
            unwanted = [one for one in self.unwanted if one.number.epoch == epoch]
            self.unwanted = [one for one in self.unwanted if one.number.epoch != epoch]
        return unwanted

    def clear(self) -> None:
        """Forget all attachments, because the program leaves."""
        with self._lock:
            self._wanted.clear()


def _key(header: Attach | Tap) -> tuple[Any, ...]:
    """Return a key that is equal for two attachments if one replaces the other."""
    if isinstance(header, Tap):
        return Tap, header.message, header.condition, header.listener
    return Attach, header.message, header.attachment.failure, header.attachment.handler


def _with_needed(
    formats: Iterable[MessageFormat], known: dict[str, MessageFormat]
) -> Iterator[MessageFormat]:
    """Yield formats, each after those that must be declared before it."""
    for one in formats:
        yield from _with_needed((known[name] for name in one.needs if name in known), known)
        yield one
