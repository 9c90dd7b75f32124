"""Asks a property of a journal, event by event, and says what is wrong, and with which message."""

from collections.abc import Iterable
from typing import Any

from tca_properties.algebra import Breach, NeverStuck, Property, words_of
from tca_properties.predicates import OfMessages
from tca_tools.check.matches import Matches
from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_wire.points import TaskId

_MOST_NAMED = 6
"""Messages that are named where many break a property."""


class Judge:
    """A property, and what it remembers of the run. What is wrong is "" as long as nothing is."""

    def __init__(self, stated: Property) -> None:
        self.stated = stated
        self.matches = Matches(stated.predicates)
        self.culprit = 0
        """The message by which it was broken (0: none is known)."""
        self._memory = 0
        self._had_case = False

    def after(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> str:
        """After an event: what is wrong. Where not all of the run is known, only what is certain."""
        self.matches.update(world, changed)
        self._had_case = self._had_case or self.stated.case is None or self.matches.true_of(self.stated.case).is_true
        self._memory, breach = self.stated.seen(self.matches, self._memory)
        if breach is None or not (world.is_whole or (self.stated.is_certain and breach.messages)):
            return ""
        return self._in_words(breach)

    def at_end(self, world: JournalWorld) -> str:
        """When the journal is read: what is wrong. Of what was to come within some time, that may not be over."""
        left = [task for task in world.tasks if not task.is_over]
        if isinstance(self.stated, NeverStuck) and left:
            return f"when the journal ends, these have not: {self._blame(left)}"
        if self._memory or not (world.is_whole and self.stated.is_owed(self._memory)):
            return ""
        name = next((one.message for one in self.stated.named), "")
        left = [item for item in world.messages if name and item.message == name and not item.is_over]
        if left:
            return f"it never did; what stands when the journal ends: {self._blame(left)}"
        self.culprit = max((number for number, gone in world.over.items() if name and gone.message == name), default=0)
        last = f"; {world.name(TaskId(self.culprit))} was the last to end" if self.culprit else ""
        return f"it never did{last}"

    @property
    def vacuous(self) -> str:
        """Why it says nothing that it holds; "" if it says something."""
        for one in self.stated.predicates:
            if isinstance(one, OfMessages) and not self.matches.has_subject(one):
                return f"in this run there never was '{one.subject}'" if one.message or one.data else ""
        return "" if self._had_case else f"in this run there never was '{words_of(self.stated.case)}'"

    def _in_words(self, breach: Breach) -> str:
        newest = max((one.id for one in breach.newest), default=0)
        return ": ".join(part for part in (breach.what, self._blame(breach.messages, newest)) if part)

    def _blame(self, items: Iterable[Any], culprit: int = 0) -> str:
        """The messages (a ``TaskAt`` will do) in words; the first of them is the culprit, if no other is."""
        found = sorted(items, key=lambda item: item.id)
        self.culprit = culprit or (found[0].id if found else 0)
        named = found[:_MOST_NAMED]
        if len(found) > _MOST_NAMED and self.culprit not in {item.id for item in named}:
            named[-1] = next(item for item in found if item.id == self.culprit)
        more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
        return ", ".join(map(str, named)) + more
