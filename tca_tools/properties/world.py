"""The world that properties see after each event of a run, explored or read from a journal."""

from collections.abc import Callable, Collection, Iterable
from typing import Any, NamedTuple, Protocol

from tca_wire.messages.formats import decode_untyped
from tca_wire.points import END_ACHIEVING, END_PLANNING, START_ACHIEVING
from tca_wire.vocabulary import MessageClass, Role


class BadProperty(ValueError):
    """Raised for an argument that is not a property or predicate; the message says what to do."""


Predicate = Callable[[Any], object]
"""A function of the world that returns the messages for which it is true, or True or False."""


class PredicateValue(NamedTuple):
    """The value of a predicate."""

    is_true: bool
    messages: Collection[Any] | None = None
    """The messages for which it is true; None if the predicate returned True or False."""

    @property
    def number(self) -> int:
        """The number of messages for which it is true."""
        return int(self.is_true) if self.messages is None else len(self.messages)

    @classmethod
    def of(cls, value: object) -> "PredicateValue":
        """Convert the value that a predicate returned."""
        if isinstance(value, Iterable) and not isinstance(value, str | bytes):
            messages = value if isinstance(value, Collection) else list(value)
            return cls(bool(messages), messages)
        return cls(bool(value), [value] if hasattr(value, "id") else None)


class PredicateValues(Protocol):
    """The current values of predicates. Properties see these; predicates see the world itself."""

    def true_of(self, predicate: Predicate) -> PredicateValue:
        """Return the messages for which a predicate is true."""

    def newly(self, predicate: Predicate) -> PredicateValue:
        """Return the messages for which a predicate became true with the last event."""

    @property
    def passed(self) -> float:
        """Seconds that passed with the last event."""


class MessageView:
    """A message under way: a task, a query, an inform, or one copy of a broadcast or multi-query.

    A message that ended with the last event is still under way.
    """

    __slots__ = ()

    message: str
    message_class: MessageClass
    sender: str
    body: bytes
    reached: int
    """The moments it has reached, as bits; a killed task reaches all of them when it ends."""
    role: Role
    """Why central sent it; "" if a module did."""
    failure: str
    """The failure raised on it that has not been dealt with."""
    attempts: int
    """The number of attempts to handle it: 1 and one for each retry."""
    is_begun: bool
    """Whether a handler was given it, now or before."""
    is_killed: bool
    is_suspended: bool
    is_over: bool
    """Whether it ended with the last event."""
    is_new: bool
    """Whether it was sent with the last event."""
    is_resolved: bool
    """Whether an exception handler has resolved its failure since its last handling or retry."""
    is_retried: bool
    """Whether it was retried with the last event."""
    has_fired: bool
    """Whether this monitor sent its action with the last event."""
    is_task: bool
    """Whether it is a task."""
    state: str
    """The state of a task in its life cycle."""
    module: str
    """The module whose handler has it now; "" if none has."""
    is_queued: bool
    """Whether it waits for a resource or a handler."""
    is_recovering: bool
    """Whether an exception handler is working on its failure."""

    @property
    def data(self) -> Any:
        """Its data as plain values; None if it has none."""
        return decode_untyped(self.body) if self.body else None

    def has(self, moment: int) -> bool:
        """Whether it has reached *moment*.

        Args:
            moment: the moment, a ``Moment``.
        """
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
        """Whether it and its descendants have been expanded; always true for a command."""
        return bool(self.reached & END_PLANNING)

    @property
    def is_being_achieved(self) -> bool:
        """Whether its achievement has started and not ended."""
        return bool(self.reached & START_ACHIEVING) and not self.reached & END_ACHIEVING

    @property
    def is_achieved(self) -> bool:
        """Whether it was achieved with the last event, without a kill or a resolved failure."""
        return bool(self.reached & END_ACHIEVING) and not (self.is_killed or self.is_resolved)

    @property
    def is_done_after_failure(self) -> bool:
        """Whether it was done with the last event after a resolved failure."""
        return bool(self.reached & END_ACHIEVING) and self.is_resolved and not self.is_killed

    @property
    def is_planned_ahead(self) -> bool:
        """Whether a handler was given it, but it may not be achieved yet."""
        return self.is_begun and not self.reached & START_ACHIEVING
