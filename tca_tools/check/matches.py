"""The messages of which predicates are true: after an event only what it touched is looked at again."""

from collections.abc import Callable, Iterable
from typing import Any

from tca_properties.predicates import OfMessages
from tca_properties.world import Found, Predicate
from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld

_NOTHING = Found(is_true=False)


class Matches:
    """What the predicates of a property say of a run now. Functions are asked anew after each event."""

    def __init__(self, predicates: Iterable[Predicate]) -> None:
        self._matches: dict[int, _Match] = {id(one): _match(one) for one in predicates}
        self._world: JournalWorld | None = None
        self.passed = 0.0

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """An event is over, which changed these messages at most. Of another world than before nothing is known yet."""
        is_new, self._world, self.passed = world is not self._world, world, world.passed
        for match in self._matches.values():
            if is_new:
                match.now = {}
            match.update(world, changed)

    def true_of(self, predicate: Predicate) -> Found:
        """What one of them says."""
        return self._matches[id(predicate)].found

    def newly(self, predicate: Predicate) -> Found:
        """Of which messages it has become true with the last event."""
        return self._matches[id(predicate)].newly

    def has_subject(self, predicate: Predicate) -> bool:
        """Whether there was any message that it is about, in whatever state: else that it never held says nothing."""
        return self._matches[id(predicate)].has_subject


class _Match:
    """What one predicate says."""

    has_subject = True

    def __init__(self) -> None:
        self.now: dict[Any, None] = {}
        self.found = self.newly = _NOTHING

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
        """An event is over."""


class _OfMessages(_Match):
    def __init__(self, predicate: OfMessages) -> None:
        super().__init__()
        self.has_subject = False
        self._predicate = predicate

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
        return is_about and is_in_state


class _OfFunction(_Match):
    def __init__(self, predicate: Predicate) -> None:
        super().__init__()
        self._predicate = predicate

    def update(self, world: JournalWorld, changed: Iterable[MessageRecord]) -> None:
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


def _match(predicate: Callable[[Any], object]) -> _Match:
    return _OfMessages(predicate) if isinstance(predicate, OfMessages) else _OfFunction(predicate)
