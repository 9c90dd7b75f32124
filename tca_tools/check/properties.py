"""The user's own properties: what must be true of a run, in the words of the explorer (docs/explorer.md).

A predicate is a text (predicates.py) or a function of the World (world.py); it gives the messages of which it is true,
or a truth value. A text is looked at again only for the messages that an event touched; a function is asked after each
event.
"""

from collections.abc import Callable, Iterable, Sized
from typing import Any

from tca_tools.check.predicates import Those, predicate_from
from tca_tools.check.records import Item
from tca_tools.check.world import World
from tca_wire.points import TaskId

Predicate = Callable[[World], object]


class _Members:
    """The messages of which a predicate is true, kept up to date."""

    def __init__(self, predicate: Those | Predicate) -> None:
        self._predicate = predicate
        self.now: dict[Any, None] = {}
        self.came: list[Any] = []  #: with the last event
        self.is_true = False

    def update(self, world: World, changed: Iterable[Item]) -> None:
        """An event is over, which changed these messages at most."""
        self.came = []
        if not isinstance(self._predicate, Those):
            found = self._predicate(world)
            before = {one.id for one in self.now}
            self.now = (
                dict.fromkeys(one for one in found if hasattr(one, "id")) if isinstance(found, list | tuple) else {}
            )
            self.came = [one for one in self.now if one.id not in before]
            self.is_true = bool(found)
            self._number = len(found) if isinstance(found, Sized) else int(bool(found))
            return
        for item in changed:
            if world.items.get(item.id) is item and self._predicate.test(item):
                if item not in self.now:
                    self.came.append(item)
                self.now[item] = None
            else:
                self.now.pop(item, None)
        self._number = len(self.now)
        self.is_true = bool(self.now)

    @property
    def number(self) -> int:
        """Of how many it is true."""
        return self._number


class Property:
    """Something that must be true of every run; what is wrong is "" as long as nothing is."""

    def __init__(self, words: str, *predicates: Those | Predicate) -> None:
        self.words = words
        self.predicates = predicates
        self.members = [_Members(predicate) for predicate in predicates]
        self.culprit = 0
        """The message by which it was broken (0: none is known)."""

    def __str__(self) -> str:
        return self.words

    def after(self, world: World, changed: Iterable[Item]) -> str:
        """After an event: what is wrong."""
        changed = list(changed)
        for members in self.members:
            members.update(world, changed)
        return self._judge()

    def _judge(self) -> str:
        return ""

    def at_end(self, world: World) -> str:
        """When the journal is read: what is wrong."""
        del world
        return ""

    def blame(self, items: Iterable[Any]) -> str:
        """The messages (a task of ``Then`` will do) in words; the newest is the culprit."""
        found = sorted(items, key=lambda item: item.id)
        self.culprit = found[-1].id if found else 0
        return ", ".join(map(str, found[:6])) + (f" and {len(found) - 6} more" if len(found) > 6 else "")


class _Never(Property):
    def _judge(self) -> str:
        return (self.blame(self.members[0].now) or "here it is") if self.members[0].is_true else ""


class _Always(Property):
    def _judge(self) -> str:
        return "" if self.members[0].is_true else "here it is not"


class _AtMost(Property):
    def __init__(self, words: str, predicate: Those | Predicate, most: int) -> None:
        super().__init__(words, predicate)
        self._most = most

    def _judge(self) -> str:
        members = self.members[0]
        return f"here {members.number}: {self.blame(members.now)}" if members.number > self._most else ""


class _AtMostInAll(_AtMost):
    def __init__(self, words: str, predicate: Those | Predicate, most: int) -> None:
        super().__init__(words, predicate, most)
        self._count = 0

    def _judge(self) -> str:
        members = self.members[0]
        self._count += len(members.came) if members.now else int(members.is_true)
        return f"here it comes to {self._count}: {self.blame(members.came)}" if self._count > self._most else ""


class _Before(Property):
    def __init__(self, words: str, first: Those | Predicate, second: Those | Predicate) -> None:
        super().__init__(words, first, second)
        self._has_been = False

    def _judge(self) -> str:
        first, second = self.members
        self._has_been = self._has_been or first.is_true
        if self._has_been or not second.is_true:
            return ""
        names = self.blame(second.now)
        return f"the second came first{': ' * bool(names)}{names}"


class _Eventually(Property):
    def __init__(self, words: str, predicate: Those | Predicate) -> None:
        super().__init__(words, predicate)
        self._has_been = False

    def _judge(self) -> str:
        self._has_been = self._has_been or self.members[0].is_true
        return ""

    def at_end(self, world: World) -> str:
        if self._has_been:
            return ""
        predicate = self.predicates[0]
        name = predicate.message if isinstance(predicate, Those) else ""
        left = [item for item in world.messages if name and item.message == name and not item.is_over]
        if left:
            return f"it never did; what stands when the journal ends: {self.blame(left)}"
        ended = [number for number, gone in world.over.items() if name and gone.message == name]
        self.culprit = max(ended, default=0)
        return f"it never did; {world.name(TaskId(self.culprit))} was the last to end" if ended else "it never did"


class _NeverStuck(Property):
    def at_end(self, world: World) -> str:
        left = [task for task in world.tasks if not task.is_over]
        return f"when the journal ends, these have not: {self.blame(left)}" if left else ""


def never(predicate: str | Those | Predicate) -> Property:
    """*predicate* is never true."""
    return _Never(f"never {words_of(predicate)}", _made(predicate))


def always(predicate: str | Those | Predicate) -> Property:
    """*predicate* is true after every event."""
    return _Always(f"always {words_of(predicate)}", _made(predicate))


def at_most(number: int, predicate: str | Those | Predicate) -> Property:
    """*predicate* is true of at most *number* messages at a time."""
    return _AtMost(f"at most {number} {words_of(predicate)}", _made(predicate), number)


def at_most_in_all(number: int, predicate: str | Those | Predicate) -> Property:
    """*predicate* becomes true at most *number* times."""
    return _AtMostInAll(f"at most {number} {words_of(predicate)} in all", _made(predicate), number)


def before(first: str | Those | Predicate, second: str | Those | Predicate) -> Property:
    """Where *second* becomes true, *first* has been true before, or becomes true with the same event."""
    return _Before(f"{words_of(first)} before {words_of(second)}", _made(first), _made(second))


def eventually(predicate: str | Those | Predicate) -> Property:
    """*predicate* becomes true before the journal ends."""
    return _Eventually(f"eventually {words_of(predicate)}", _made(predicate))


def never_stuck() -> Property:
    """When the journal ends, all tasks have."""
    return _NeverStuck("never stuck")


def words_of(predicate: object) -> str:
    """A predicate in words."""
    if isinstance(predicate, str):
        return predicate
    words = getattr(predicate, "words", "") or getattr(predicate, "__name__", repr(predicate))
    return str(words).replace("_", " ")


def _made(predicate: str | Those | Predicate) -> Those | Predicate:
    return predicate_from(predicate) if isinstance(predicate, str) else predicate
