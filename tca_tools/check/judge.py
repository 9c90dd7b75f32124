"""Check a property event by event, and describe a breach with its message."""

from collections.abc import Iterable
from typing import Any

from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_tools.properties.algebra import Breach, NeverStuck, Property, words_of
from tca_tools.properties.cases import CasesProperty, Counted
from tca_tools.properties.predicates import OfMessages
from tca_tools.properties.world import Predicate, PredicateValue

_MOST_NAMED = 6
"""The most messages that the description of a breach names."""


class Judge:
    """A property with its memory of the run. Methods return the breach in words, "" for none."""

    def __init__(self, prop: Property) -> None:
        self.prop = prop
        self.matches = Matches(prop.predicates)
        self.culprit = 0
        """The message by which it was broken (0: none is known)."""
        self.counted: Counted | None = None
        """The counts of a property of cases, at the end of the run."""
        self._memory = 0
        """The number that the property remembers."""
        self._had_case = False
        """Whether the case of the property has arisen."""

    def after(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> str:
        """Check after an event; if parts of the run are missing, report only certain breaches."""
        self.matches.update(world, changed)
        case = self.prop.case
        self._had_case = self._had_case or case is None or self.matches.true_of(case).is_true
        self._memory, breach = self.prop.seen(self.matches, self._memory)
        if breach is None or not (world.is_whole or (self.prop.is_certain and breach.messages)):
            return ""
        return self._in_words(breach)

    def at_end(self, world: JournalWorld) -> str:
        """Check at the end of the journal; a time limit that has not passed is no breach."""
        if isinstance(self.prop, CasesProperty):
            return self._of_cases(self.prop, world)
        left = [task for task in world.tasks if not task.is_over]
        if isinstance(self.prop, NeverStuck) and left:
            return f"not ended when the journal ends: {self._blame(left)}"
        if self._memory or not (world.is_whole and self.prop.is_owed(self._memory)):
            return ""
        name = next((one.message for one in self.prop.named), "")
        left = [
            item for item in world.messages if name and item.message == name and not item.is_over
        ]
        if left:
            return f"it never did; not ended when the journal ends: {self._blame(left)}"
        over = (number for number, ended in world.over.items() if name and ended.message == name)
        self.culprit = max(over, default=0)
        if self.culprit:
            return f"it never did; {world.name(self.culprit)} was the last to end"
        return "it never did"

    def _of_cases(self, prop: CasesProperty, world: JournalWorld) -> str:
        """Check the cases of a whole run; nothing can be said about a part of one."""
        if not world.is_whole or world.history is None:
            return ""
        self.counted = prop.count(world.history)
        if prop.allows(self.counted):
            return ""
        return f"true in {self.counted} cases, not for {self._blame(self.counted.bad)}"

    @property
    def why_vacuous(self) -> str:
        """Why the property holds trivially; "" if it does not."""
        if isinstance(self.prop, CasesProperty):
            return self.prop.why_not_judged(self.counted) if self.counted is not None else ""
        for one in self.prop.predicates:
            if isinstance(one, OfMessages) and not self.matches.has_subject(one):
                named = one.message or one.data
                return f"in this run there never was '{one.subject}'" if named else ""
        if self._had_case:
            return ""
        return f"in this run there never was '{words_of(self.prop.case)}'"

    def _in_words(self, breach: Breach) -> str:
        newest = max((one.id for one in breach.newest), default=0)
        parts = breach.what, self._blame(breach.messages, newest)
        return ": ".join(filter(None, parts))

    def _blame(self, items: Iterable[Any], culprit: int = 0) -> str:
        """Return messages in words, and store the culprit, which comes first.

        The culprit is the message with number *culprit*, or else the oldest one.
        """
        found = sorted(items, key=lambda item: (item.id != culprit, item.id))
        self.culprit = found[0].id if found else 0
        more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
        return ", ".join(map(str, found[:_MOST_NAMED])) + more


class Matches:
    """The messages for which the predicates of a property are true.

    After an event, a predicate of messages is tested again for the changed messages only. Any other
    predicate is a function, which is called again.
    """

    def __init__(self, predicates: Iterable[Predicate]) -> None:
        self._matches: dict[int, _Match] = {
            id(one): _OfMessages(one) if isinstance(one, OfMessages) else _Match(one)
            for one in predicates
        }
        self._world: JournalWorld | None = None
        self.passed = 0.0

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """Update the matches after an event that changed some messages.

        Args:
            world: The world. If it is another one than before, all matches are forgotten.
            changed: All messages that the event changed, and perhaps others.
        """
        is_new, self._world, self.passed = world is not self._world, world, world.passed
        for match in self._matches.values():
            if is_new:
                match.now = {}
            match.update(world, changed)

    def true_of(self, predicate: Predicate) -> PredicateValue:
        """Return the value of a predicate."""
        return self._matches[id(predicate)].found

    def newly(self, predicate: Predicate) -> PredicateValue:
        """Return the messages for which a predicate became true with the last event."""
        return self._matches[id(predicate)].newly

    def has_subject(self, predicate: Predicate) -> bool:
        """Whether the run had a message that a predicate is about, in any state."""
        return self._matches[id(predicate)].has_subject


class _Match:
    """The matches of a function, which is called after each event."""

    has_subject = True

    def __init__(self, predicate: Any) -> None:
        self.now: dict[Any, None] = {}
        self.found = self.newly = PredicateValue(is_true=False)
        self._predicate = predicate

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """Update the matches after an event."""
        del changed
        value = self._predicate(world)
        self.found = self.newly = PredicateValue.of(value)
        messages = self.found.messages
        if messages is None and (value is None or isinstance(value, bool)):
            return
        if messages is None or not all(hasattr(one, "id") for one in messages):
            raise TypeError(
                f"it returned {value!r:.60}: a predicate returns the messages for which it is "
                "true, or True or False"
            )
        before, self.now = {one.id for one in self.now}, dict.fromkeys(messages)
        new = [one for one in messages if one.id not in before]
        self.newly = PredicateValue(bool(new), new)


class _OfMessages(_Match):
    """The matches of a predicate of messages; only changed messages are tested."""

    has_subject = False

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        new = []
        for item in changed:
            if world.items.get(item.id) is item and self._holds(item):
                if item not in self.now:
                    new.append(item)
                self.now[item] = None
            else:
                self.now.pop(item, None)
        self.found = PredicateValue(bool(self.now), self.now)
        self.newly = PredicateValue(bool(new), new)

    def _holds(self, item: MessageRecord) -> bool:
        is_in_state = self._predicate.is_in_state(item)
        if self.has_subject and not is_in_state:  # the cheaper test comes first
            return False
        is_about = self._predicate.is_about(item)
        self.has_subject = self.has_subject or is_about
        return bool(is_about and is_in_state)
