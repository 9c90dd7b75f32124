"""The user's own properties: what must be true of a run, in the words of the explorer (docs/explorer.md).

A predicate is a text (predicates.py) or a function of the World (world.py); it gives the messages of which it is true,
or a truth value. A text is looked at again only for the messages that an event touched; a function is asked after each
event.
"""

from collections.abc import Callable, Iterable
from typing import Any

from tca_tools.check.predicates import Those, predicate_from
from tca_tools.check.records import Item
from tca_tools.check.world import World
from tca_wire.points import TaskId

Predicate = Callable[[World], object]
_MOST_NAMED = 6
"""Messages that are named where many break a property."""


class _Members:
    """The messages of which a predicate is true, kept up to date."""

    def __init__(self, predicate: Those | Predicate) -> None:
        self._predicate = predicate
        self.now: dict[Any, None] = {}
        self.came: list[Any] = []  #: with the last event
        self.is_true = False
        self.is_list = True  #: whether it tells of which: else only whether

    def update(self, world: World, changed: Iterable[Item]) -> None:
        """An event is over, which changed these messages at most."""
        self.came = []
        predicate = self._predicate
        if not isinstance(predicate, Those):
            self._ask(predicate, world)
            return
        for item in changed:
            if world.items.get(item.id) is item and predicate.test(item):
                if item not in self.now:
                    self.came.append(item)
                self.now[item] = None
            else:
                self.now.pop(item, None)
        self.is_true = bool(self.now)

    def _ask(self, predicate: Predicate, world: World) -> None:
        """A function tells anew of which messages it is true, or whether it is."""
        before = {one.id for one in self.now}
        found = _those_found(predicate(world))
        if isinstance(found, bool):
            self.now, self.is_true, self.is_list = {}, found, False
        else:
            self.now, self.is_true, self.is_list = dict.fromkeys(found), bool(found), True
        self.came = [one for one in self.now if one.id not in before]

    def forget(self) -> None:
        """What was under way is not known any more."""
        self.now, self.is_true = {}, False

    @property
    def number(self) -> int:
        """Of how many it is true."""
        return len(self.now) if self.is_list else int(self.is_true)

    @property
    def under_way(self) -> list[Any]:
        """Those of them that count at a time: of what has ended with this event that it was begun, say, does not."""
        predicate = self._predicate
        if isinstance(predicate, Those) and predicate.ends_with_its_message:
            return [one for one in self.now if not one.is_over]
        return list(self.now)


def _those_found(found: object) -> bool | list[Any]:
    """What a predicate that is a function gave. Raises TypeError if it is neither messages nor a truth value."""
    if found is None or isinstance(found, bool):
        return bool(found)
    if hasattr(found, "id"):
        return [found]
    items = list(found) if isinstance(found, Iterable) and not isinstance(found, str | bytes) else [found]
    if all(hasattr(one, "id") for one in items):
        return items
    msg = f"it gave {found!r:.60}: a predicate gives the messages of which it is true, or True or False"
    raise TypeError(msg)


class Property:
    """Something that must be true of every run; what is wrong is "" as long as nothing is."""

    def __init__(self, words: str, *predicates: Those | Predicate) -> None:
        self.words = words
        self.predicates = predicates
        self.members = [_Members(predicate) for predicate in predicates]
        self.culprit = 0
        """The message by which it was broken (0: none is known)."""
        self.had_case = False
        """Whether there was anything to judge it by."""
        self._world: World | None = None

    def __str__(self) -> str:
        return self.words

    def after(self, world: World, changed: Iterable[Item]) -> str:
        """After an event: what is wrong. Where the world begins anew, because something can't be read, it goes by what
        is certain all the same.
        """
        changed = list(changed)
        is_new, self._world = world is not self._world, world
        for members in self.members:
            if is_new:
                members.forget()
            members.update(world, changed)
        self.had_case = self.had_case or self._has_case()
        return self._judge(is_whole=world.is_whole)

    def _judge(self, *, is_whole: bool) -> str:
        """What is wrong, with what is true now; if not *is_whole*, without claims about what is not known."""
        del is_whole
        return ""

    def _has_case(self) -> bool:
        return True

    @property
    def vacuous(self) -> str:
        """Why it says nothing that it holds; "" if it says something."""
        those = [one for one in self.predicates if isinstance(one, Those)]
        absent = next((one for one in those if not one.has_subject), None)
        if absent is not None:
            return f"in this run there never was '{absent.subject}'" if absent.message or absent.wanted else ""
        return "" if self.had_case else f"in this run there never was '{words_of(self.predicates[-1])}'"

    def at_end(self, world: World) -> str:
        """When the journal is read: what is wrong."""
        del world
        return ""

    def blame(self, items: Iterable[Any], culprit: int = 0) -> str:
        """The messages (a task of ``RunAt`` will do) in words; the first of them is the culprit, if no other is."""
        found = sorted(items, key=lambda item: item.id)
        self.culprit = culprit or (found[0].id if found else 0)
        named = found[:_MOST_NAMED]
        if len(found) > _MOST_NAMED and self.culprit not in {item.id for item in named}:
            named[-1] = next(item for item in found if item.id == self.culprit)
        more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
        return ", ".join(map(str, named)) + more


class _Never(Property):
    def _judge(self, *, is_whole: bool) -> str:
        members = self.members[0]
        if not members.is_true or not (is_whole or members.is_list):
            return ""
        return self.blame(members.now) or "here it is"


class _Always(Property):
    def _judge(self, *, is_whole: bool) -> str:
        return "" if self.members[0].is_true or not is_whole else "here it is not"


class _AtMost(Property):
    def __init__(self, words: str, predicate: Those | Predicate, most: int) -> None:
        super().__init__(words, predicate)
        self._most = most

    def _judge(self, *, is_whole: bool) -> str:
        members = self.members[0]
        if members.number <= self._most or not (is_whole or members.is_list):
            return ""
        found = members.under_way
        number = len(found) if members.is_list else members.number
        if number <= self._most:
            return ""
        newest = max((one.id for one in members.came), default=0) or max((one.id for one in found), default=0)
        return f"here {number}: {self.blame(found, newest)}"

    def _has_case(self) -> bool:
        return self.members[0].is_true


class _AtMostInAll(_AtMost):
    def __init__(self, words: str, predicate: Those | Predicate, most: int) -> None:
        super().__init__(words, predicate, most)
        self._count = 0

    def _judge(self, *, is_whole: bool) -> str:
        members = self.members[0]
        self._count += len(members.came) if members.is_list else int(members.is_true)
        if self._count <= self._most or not (is_whole or members.is_list):
            return ""
        return f"here it comes to {self._count}: {self.blame(members.came)}"


class _Before(Property):
    def __init__(self, words: str, first: Those | Predicate, second: Those | Predicate) -> None:
        super().__init__(words, first, second)
        self._has_been = False

    def _judge(self, *, is_whole: bool) -> str:
        first, second = self.members
        self._has_been = self._has_been or first.is_true
        if self._has_been or not second.is_true or not is_whole:
            return ""
        names = self.blame(second.now)
        return f"the second came first{': ' * bool(names)}{names}"

    def _has_case(self) -> bool:
        return self.members[1].is_true


class _Eventually(Property):
    def __init__(self, words: str, predicate: Those | Predicate) -> None:
        super().__init__(words, predicate)
        self._has_been = False

    def _judge(self, *, is_whole: bool) -> str:
        del is_whole
        self._has_been = self._has_been or self.members[0].is_true
        return ""

    def at_end(self, world: World) -> str:
        if self._has_been or not world.is_whole:
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
