"""Asks a property of a journal, event by event, and says what is wrong, and with which message."""

from collections.abc import Iterable
from typing import Any

from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_tools.properties.algebra import Breach, NeverStuck, Property, words_of
from tca_tools.properties.cases import CasesProperty, Counted
from tca_tools.properties.predicates import OfMessages
from tca_tools.properties.world import Found, Predicate

_MOST_NAMED = 6
"""Messages that are named where many break a property."""


class Judge:
    """A property, and what it remembers of the run. What is wrong is "" as long as nothing is."""

    def __init__(self, stated: Property) -> None:
        self.stated = stated
        self.matches = Matches(stated.predicates)
        self.culprit = 0
        """The message by which it was broken (0: none is known)."""
        self.counted: Counted | None = None
        """Of a property of cases, once they were counted: how many there were."""
        self._memory = 0
        self._had_case = False

    def after(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> str:
        """After an event: what is wrong. Where not all of the run is known, only what is
        certain.
        """
        self.matches.update(world, changed)
        self._had_case = (
            self._had_case
            or self.stated.case is None
            or self.matches.true_of(self.stated.case).is_true
        )
        self._memory, breach = self.stated.seen(self.matches, self._memory)
        if breach is None or not (world.is_whole or (self.stated.is_certain and breach.messages)):
            return ""
        return self._in_words(breach)

    def at_end(self, world: JournalWorld) -> str:
        """When the journal is read: what is wrong. Of what was to come within some time, that may
        not be over.
        """
        if isinstance(self.stated, CasesProperty):
            return self._of_cases(self.stated, world)
        left = [task for task in world.tasks if not task.is_over]
        if isinstance(self.stated, NeverStuck) and left:
            return f"when the journal ends, these have not: {self._blame(left)}"
        if self._memory or not (world.is_whole and self.stated.is_owed(self._memory)):
            return ""
        name = next((one.message for one in self.stated.named), "")
        left = [
            item for item in world.messages if name and item.message == name and not item.is_over
        ]
        if left:
            return f"it never did; what stands when the journal ends: {self._blame(left)}"
        self.culprit = max(
            (number for number, gone in world.over.items() if name and gone.message == name),
            default=0,
        )
        return (
            f"it never did; {world.name(self.culprit)} was the last to end"
            if self.culprit
            else "it never did"
        )

    def _of_cases(self, stated: CasesProperty, world: JournalWorld) -> str:
        """What is wrong with the cases of the run. Of a part of one nothing can be said."""
        if not world.is_whole or world.history is None:
            return ""
        self.counted = stated.count(world.history)
        if stated.allows(self.counted):
            return ""
        return f"here it is so in {self.counted}, not with {self._blame(self.counted.bad)}"

    @property
    def vacuous(self) -> str:
        """Why it says nothing that it holds; "" if it says something."""
        if isinstance(self.stated, CasesProperty):
            return self.stated.why_not_judged(self.counted) if self.counted is not None else ""
        for one in self.stated.predicates:
            if isinstance(one, OfMessages) and not self.matches.has_subject(one):
                return (
                    f"in this run there never was '{one.subject}'"
                    if one.message or one.data
                    else ""
                )
        return (
            "" if self._had_case else f"in this run there never was '{words_of(self.stated.case)}'"
        )

    def _in_words(self, breach: Breach) -> str:
        newest = max((one.id for one in breach.newest), default=0)
        return ": ".join(
            part for part in (breach.what, self._blame(breach.messages, newest)) if part
        )

    def _blame(self, items: Iterable[Any], culprit: int = 0) -> str:
        """The messages (a ``TaskAt`` will do) in words, the culprit first; if none is known, that
        is the oldest.
        """
        found = sorted(items, key=lambda item: (item.id != culprit, item.id))
        self.culprit = found[0].id if found else 0
        more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
        return ", ".join(map(str, found[:_MOST_NAMED])) + more


class Matches:
    """The messages of which the predicates of a property are true. After an event only what it
    touched is looked at again; functions are asked anew.
    """

    def __init__(self, predicates: Iterable[Predicate]) -> None:
        self._matches: dict[int, _Match] = {
            id(one): _OfMessages(one) if isinstance(one, OfMessages) else _Match(one)
            for one in predicates
        }
        self._world: JournalWorld | None = None
        self.passed = 0.0

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """An event is over, which changed these messages at most. Of another world than before
        nothing is known yet.
        """
        is_new, self._world, self.passed = world is not self._world, world, world.passed
        for match in self._matches.values():
            if is_new:
                match.now = {}
            match.update(world, changed)

    def true_of(self, predicate: Predicate) -> Found:
        """The value of a predicate."""
        return self._matches[id(predicate)].found

    def newly(self, predicate: Predicate) -> Found:
        """Of which messages it has become true with the last event."""
        return self._matches[id(predicate)].newly

    def has_subject(self, predicate: Predicate) -> bool:
        """Whether there was any message that it is about, in whatever state: else that it never
        held says nothing.
        """
        return self._matches[id(predicate)].has_subject


class _Match:
    """The matches of one predicate: of a function, which is asked anew after each event."""

    has_subject = True

    def __init__(self, predicate: Any) -> None:
        self.now: dict[Any, None] = {}
        self.found = self.newly = Found(is_true=False)
        self._predicate = predicate

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """An event is over."""
        del changed
        value = self._predicate(world)
        self.found = self.newly = Found.of(value)
        messages = self.found.messages
        if messages is None and (value is None or isinstance(value, bool)):
            return
        if messages is None or not all(hasattr(one, "id") for one in messages):
            msg = f"it gave {value!r:.60}: a predicate gives the messages of which it is true, or True or False"
            raise TypeError(msg)
        before, self.now = {one.id for one in self.now}, dict.fromkeys(messages)
        came = [one for one in messages if one.id not in before]
        self.newly = Found(bool(came), came)


class _OfMessages(_Match):
    has_subject = False

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        came = []
        for item in changed:
            if world.items.get(item.id) is item and self._holds(item):
                if item not in self.now:
                    came.append(item)
                self.now[item] = None
            else:
                self.now.pop(item, None)
        self.found, self.newly = Found(bool(self.now), self.now), Found(bool(came), came)

    def _holds(self, item: MessageRecord) -> bool:
        is_in_state = self._predicate.is_in_state(item)
        if self.has_subject and not is_in_state:  # the cheaper question first
            return False
        is_about = self._predicate.is_about(item)
        self.has_subject = self.has_subject or is_about
        return bool(is_about and is_in_state)
