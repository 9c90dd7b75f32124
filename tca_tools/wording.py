"""The facts of a journal in words, one line each. Remembers the names of messages, and nothing else."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from tca_wire import facts
from tca_wire.constraints import Constraint
from tca_wire.points import Point, describe_moments


class Wording:
    """Facts in words; a name stays known as long as facts about it may come."""

    def __init__(self) -> None:
        self._names: dict[int, str] = {}

    def words(self, fact: facts.Fact) -> str:
        """What a fact says, without its kind and body."""
        if isinstance(fact, facts.Received):
            self._names[fact.id] = fact.message
        elif isinstance(fact, facts.Delivered | facts.Queued):
            self._names.setdefault(fact.id, self._names.get(fact.message_id, "?"))
        say = _SAY.get(type(fact))
        return say(self, fact) if say else ""

    def _name(self, number: int) -> str:
        return f"{self._names.get(number, '?')} {{{number}}}"

    def _point(self, point: Point) -> str:
        return f"{_moments(point.moment)} of {self._name(point.task)}"

    def _constraints(self, constraints: list[Constraint]) -> str:
        return "; ".join(f"{self._point(c.before)} before {self._point(c.after)}" for c in constraints)

    def _opened(self, fact: facts.Opened) -> str:
        try:
            began = f"{datetime.fromtimestamp(fact.began, UTC):%Y-%m-%d %H:%M:%S} UTC"
        except (ValueError, OverflowError, OSError):
            began = "at no known time"
        return f"segment {fact.segment} of {fact.epoch}, by central {fact.central}, began {began}"

    def _closed(self, fact: facts.Closed) -> str:
        return fact.why

    def _joined(self, fact: facts.ModuleJoined) -> str:
        return f"{fact.module}, {fact.process}" if fact.process else fact.module

    def _left(self, fact: facts.ModuleLeft) -> str:
        return f"{fact.module}: {fact.why}"

    def _resource(self, fact: facts.ResourceChanged) -> str:
        return f"{place(fact.module, fact.resource)} takes {fact.capacity} at a time"

    def _format(self, fact: facts.FormatDefined) -> str:
        return f"{fact.message_class} {fact.message}, declared by {fact.module}"

    def _handler(self, fact: facts.HandlerAdded) -> str:
        return f"{place(fact.module, fact.resource)} handles {fact.message}"

    def _no_handler(self, fact: facts.HandlerRemoved) -> str:
        return f"{fact.module} handles {fact.message} no longer"

    def _received(self, fact: facts.Received) -> str:
        words = f"{fact.message_class} {self._name(fact.id)} from {fact.sender}"
        if fact.parent:
            words += f" under {self._name(fact.parent)}"
        elif fact.origin:
            words += f" in {self._name(fact.origin)}"
        words += ", which waits" if fact.blocking else ""
        after = [f"{_moments(c.after.moment)} after {self._point(c.before)}" for c in fact.constraints]
        return "; ".join([words, *after])

    def _constrained(self, fact: facts.Constrained) -> str:
        return self._constraints(fact.constraints)

    def _queued(self, fact: facts.Queued) -> str:
        return f"{self._name(fact.message_id)} for {place(fact.module, fact.resource) or 'a handler'}"

    def _unqueued(self, fact: facts.Unqueued) -> str:
        return self._name(fact.id)

    def _delivered(self, fact: facts.Delivered) -> str:
        copy = f" of message {{{fact.message_id}}}" if fact.id != fact.message_id else ""
        return f"{self._name(fact.id)}{copy} to {place(fact.module, fact.resource)}"

    def _returned(self, fact: facts.Returned) -> str:
        return f"{self._name(fact.id)}: {fact.outcome}"

    def _reached(self, fact: facts.Reached) -> str:
        return f"{self._name(fact.task)}: {_moments(fact.moments)}"

    def _failed(self, fact: facts.Failed) -> str:
        return f"{self._name(fact.id)}: {fact.failure}" + (f": {fact.text}" if fact.text else "")

    def _killed(self, fact: facts.Killed) -> str:
        return f"{self._name(fact.task)}: {fact.why}"

    def _dropped(self, fact: facts.Dropped) -> str:
        return f"{self._name(fact.id)}: {fact.why}"

    def _answered(self, fact: facts.Answered) -> str:
        return self._name(fact.id)

    def _wait_began(self, fact: facts.WaitBegan) -> str:
        return f"{self._waiter(fact)} until {_moments(fact.moment)} of {self._name(fact.task)}"

    def _wait_ended(self, fact: facts.WaitEnded) -> str:
        return f"{self._waiter(fact)} for {self._name(fact.task)}"

    def _waiter(self, fact: facts.WaitBegan | facts.WaitEnded) -> str:
        return f"{fact.module} in {self._name(fact.origin)}" if fact.origin else fact.module

    def _refused(self, fact: facts.RequestRefused) -> str:
        return f"{fact.sender}: {fact.refusal}: {fact.text}"


def place(module: str, resource: str) -> str:
    """A module's resource: only the module's name where both are named alike."""
    return module if resource in ("", module) else f"{module} / {resource}"


def _moments(moments: int) -> str:
    return ", ".join(describe_moments(moments)) or f"moment {moments:d}"


# ruff: noqa: SLF001
_SAY: dict[type, Callable[[Wording, Any], str]] = {
    facts.Opened: Wording._opened,
    facts.Closed: Wording._closed,
    facts.ModuleJoined: Wording._joined,
    facts.ModuleLeft: Wording._left,
    facts.ResourceChanged: Wording._resource,
    facts.FormatDefined: Wording._format,
    facts.HandlerAdded: Wording._handler,
    facts.HandlerRemoved: Wording._no_handler,
    facts.Received: Wording._received,
    facts.Constrained: Wording._constrained,
    facts.Queued: Wording._queued,
    facts.Unqueued: Wording._unqueued,
    facts.Delivered: Wording._delivered,
    facts.Returned: Wording._returned,
    facts.Reached: Wording._reached,
    facts.Failed: Wording._failed,
    facts.Killed: Wording._killed,
    facts.Dropped: Wording._dropped,
    facts.Answered: Wording._answered,
    facts.WaitBegan: Wording._wait_began,
    facts.WaitEnded: Wording._wait_ended,
    facts.RequestRefused: Wording._refused,
}
