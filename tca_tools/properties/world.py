"""The world that properties see after each event of a run: explorations and journals each have
one.
"""

from collections.abc import Callable, Collection, Iterable
from typing import Any, NamedTuple, Protocol

from tca_wire.messages.formats import decode_untyped
from tca_wire.points import END_ACHIEVING, END_PLANNING, START_ACHIEVING
from tca_wire.vocabulary import MessageClass, Role


class BadProperty(ValueError):
    """An argument is no property, or no predicate; the message says what, which and what to do."""


Predicate = Callable[[Any], object]
"""A function of the world: it gives the messages of which it is true, or whether it is true."""


class Found(NamedTuple):
    """The value of a predicate."""

    is_true: bool
    messages: Collection[Any] | None = None
    """The messages of which it is true; None if it said only whether it is."""

    @property
    def number(self) -> int:
        """Of how many messages it is true."""
        return int(self.is_true) if self.messages is None else len(self.messages)

    @classmethod
    def of(cls, value: object) -> "Found":
        """The meaning of a function's value."""
        if isinstance(value, Iterable) and not isinstance(value, str | bytes):
            messages = value if isinstance(value, Collection) else list(value)
            return cls(bool(messages), messages)
        return cls(bool(value), [value] if hasattr(value, "id") else None)


class PredicateValues(Protocol):
    """The values of predicates now. The properties ask this; predicates ask the world of the run
    itself.
    """

    def true_of(self, predicate: Predicate) -> Found:
        """Of which messages it is true."""

    def newly(self, predicate: Predicate) -> Found:
        """Of which messages it has become true with the last event."""

    @property
    def passed(self) -> float:
        """Seconds that passed with the last event."""


class MessageView:
    """A message under way: a task of the tree, or a query, an inform, or one copy of a broadcast or
    multi-query.

    What ended with the last event is still there; what ended before is not.
    """

    __slots__ = ()

    message: str
    message_class: MessageClass
    sender: str
    body: bytes
    reached: int
    """Its moments so far; a killed task has reached all when it ends."""
    role: Role
    """Why central sent it; "": a module did."""
    failure: str
    """The failure that was raised on it and has not been dealt with."""
    attempts: int
    """How often it has been, or is to be, handled: each retry is one more."""
    is_begun: bool
    """A handler was given it."""
    is_killed: bool
    is_suspended: bool
    is_over: bool
    """It ended with the last event."""
    is_new: bool
    """It was sent with the last event."""
    is_resolved: bool
    """An exception handler has resolved a failure of it since it was handled, or retried, last."""
    is_retried: bool
    """It was retried with the last event."""
    has_fired: bool
    """Of a monitor: it sent its action with the last event."""
    is_task: bool
    """It is a node of the tree."""
    state: str
    """Of a task: where it is in its life cycle."""
    module: str
    """The module whose handler has it now."""
    is_queued: bool
    """It waits for a resource or for a handler."""
    is_recovering: bool
    """An exception handler is at work on its failure."""

    @property
    def data(self) -> Any:
        """The data sent with it, as plain values; None if it has none, such as for a module that
        was lost.
        """
        return decode_untyped(self.body) if self.body else None

    def has(self, moment: int) -> bool:
        """Whether it has reached *moment*."""
        return bool(self.reached & moment)

    @property
    def is_handled(self) -> bool:
        """Whether a handler has it now."""
        return bool(self.module)

    @property
    def is_fire(self) -> bool:
        """Whether a wiretap or a monitor has just sent it."""
        return self.is_new and self.role in (Role.LISTENER, Role.ACTION)

    @property
    def is_planned(self) -> bool:
        """Whether it and everything under it has been expanded; of a command always."""
        return bool(self.reached & END_PLANNING)

    @property
    def is_being_achieved(self) -> bool:
        """Whether its achieving has started and not ended."""
        return bool(self.reached & START_ACHIEVING) and not self.reached & END_ACHIEVING

    @property
    def is_achieved(self) -> bool:
        """Whether it was achieved, not killed and not after a failure, with the last event."""
        return bool(self.reached & END_ACHIEVING) and not (self.is_killed or self.is_resolved)

    @property
    def is_done_after_failure(self) -> bool:
        """Whether it was done with the last event, after a failure that was resolved."""
        return bool(self.reached & END_ACHIEVING) and self.is_resolved and not self.is_killed

    @property
    def is_planned_ahead(self) -> bool:
        """Whether it was begun before it may be achieved."""
        return self.is_begun and not self.reached & START_ACHIEVING
