"""The world that properties see after an action: that of ``tca check`` without ids and times.

Two states that differ only in ids, orders and absolute times are explored as one state. Properties
must therefore not see these differences. Messages come in an order that follows from the state, not
from their age. Ids can only be compared. If a property reads the time, the time becomes part of the
state.
"""

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import NoReturn

import msgspec

from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_tools.properties.algebra import Breach
from tca_tools.properties.world import MessageView, Predicate, PredicateValue
from tca_wire.points import Moment

_DIGITS = 6  # decimals of a time in seconds


class Name:
    """An id that can only be compared: its number differs from run to run."""

    __slots__ = ("_number",)

    def __init__(self, number: int) -> None:
        self._number = number

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Name):
            self._refuse()
        return self._number == other._number

    def __hash__(self) -> int:
        return 0  # a hash of the number would show in the order of sets

    def __repr__(self) -> str:
        return "an id"

    def _refuse(self, *_: object) -> NoReturn:
        raise TypeError(
            "an id has another number in each run, so it can only be compared with other ids (==); "
            "use world.parent(task) and world.children(task) for relatives"
        )

    __lt__ = __le__ = __gt__ = __ge__ = __int__ = __index__ = __float__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __mod__ = __bool__ = __format__ = _refuse


SEEN = tuple(MessageView.__annotations__)
"""The attributes of a message's record that properties see, with ids as ``Name``."""
_FETCH = attrgetter(*SEEN)


class Seen(MessageView):
    """A message under way: a task, query or inform, or one copy of a broadcast or multi-query."""

    def __init__(self, record: MessageRecord) -> None:
        vars(self).update(zip(SEEN, _FETCH(record), strict=True))
        self.id, self.parent_id = Name(record.id), Name(record.parent_id)
        self.about = Name(record.about)
        """The failing, tapped, killed or monitoring task because of which central sent it."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Seen) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(self.id)

    def __str__(self) -> str:
        return self.message


class AcceptedRequest(msgspec.Struct, frozen=True):
    """A request of a script that central has accepted."""

    sender: str
    """The module that made the request."""
    call: str
    """The module library's call that made it: "kill", "on_termination", ..."""


class Held(msgspec.Struct, frozen=True):
    """A lock or reservation in force."""

    module: str
    resource: str
    sender: str
    """The module that holds it."""
    is_reserved: bool


class Messages:
    """A collection of messages without an order: supports iteration, ``len()`` and ``in``.

    Which message is older does not show.
    """

    def __init__(self, seen: list[Seen]) -> None:
        self._seen = seen

    def __iter__(self) -> Iterator[Seen]:
        return iter(self._seen)

    def __len__(self) -> int:
        return len(self._seen)

    def __contains__(self, seen: object) -> bool:
        return any(seen is known or seen == known for known in self._seen)

    def __getitem__(self, place: object) -> NoReturn:
        raise TypeError(
            "messages have no order here: select them by their attributes, as in "
            "[task for task in world.tasks if task.message == 'walk']"
        )


class World:
    """The messages under way after an action, with those that ended with this action."""

    def __init__(
        self,
        known: JournalWorld,
        order: dict[int, int],
        taken: AcceptedRequest | None = None,
        on_time_read: Callable[[], None] = lambda: None,
    ) -> None:
        self._known = known
        self.taken = taken
        """The script's request that central accepted with the last action, or None.

        A request that was refused or came too late was not accepted.
        """
        self._on_time_read = on_time_read  #: called when a property reads the time
        # Messages from before the last action keep the order of the previous state. Newer messages
        # follow in the order in which they were sent.
        keys = sorted(known.items, key=lambda key: (key not in order, order.get(key, key)))
        self._seen = {key: Seen(known.items[key]) for key in keys}

    def true_of(self, predicate: Predicate) -> PredicateValue:
        """Return the value of *predicate* in this world.

        Args:
            predicate: the predicate, such as ``begun(MOVE_LEG)``.
        """
        return PredicateValue.of(predicate(self))

    # A predicate of an event (sent, retried, ...) is true for one action only, so each match of it
    # is new.
    newly = true_of

    @property
    def messages(self) -> Messages:
        """All messages under way."""
        return Messages(list(self._seen.values()))

    @property
    def tasks(self) -> Messages:
        """All tasks under way."""
        return Messages([seen for seen in self._seen.values() if seen.is_task])

    def parent(self, task: Seen) -> Seen | None:
        """Return the parent of *task*; None if it is the root.

        Args:
            task: a task of this world.
        """
        return next((seen for seen in self._seen.values() if seen.id == task.parent_id), None)

    def children(self, task: Seen) -> Messages:
        """Return the tasks directly under *task*.

        Args:
            task: a task of this world.
        """
        return Messages([seen for seen in self.tasks if seen.parent_id == task.id])

    def held(self, task: Seen) -> list[tuple[Moment, Moment, Seen | None]]:
        """Return the constraints on *task*, without those that have a delay.

        Args:
            task: a task of this world.

        Returns:
            For each constraint three values: a moment of *task*, the moment that must be reached
            first, and the task that must reach it. The task is None if it has ended.
        """
        keys = {seen.id: key for key, seen in self._seen.items()}
        holds = self._known.items[keys[task.id]].holds
        constraints = [hold.constraint for hold in holds if hold.due is None]
        return [
            (one.after.moment, one.before.moment, self._seen.get(one.before.task))
            for one in constraints
            if not one.delay
        ]

    @property
    def held_by(self) -> dict[tuple[str, str], Held]:
        """The locks and reservations in force, by module and resource."""
        return {
            key: Held(claim.module, claim.resource, claim.sender, claim.is_reserved)
            for key, claim in sorted(self._known.held_by.items())
        }

    @property
    def modules(self) -> tuple[str, ...]:
        """The names of the connected modules, sorted."""
        return tuple(sorted(self._known.modules))

    @property
    def passed(self) -> float:
        """The seconds that passed with the last action."""
        return round(self._known.passed, _DIGITS)

    @property
    def now(self) -> float:
        """Seconds since the run began.

        If a property reads this, the time is part of the state. A scenario in which time passes
        forever then has infinitely many states. ``within`` does not have this effect.
        """
        self._on_time_read()
        return round(self._known.now, _DIGITS)


def describe_breach(breach: Breach) -> str:
    """Return the error in words, and its messages with their ids."""
    names = ", ".join(
        f"{message.message} {{{int(message.id._number)}}}"  # noqa: SLF001
        if isinstance(message, Seen)
        else str(message)
        for message in breach.messages
    )
    return ": ".join(part for part in (breach.what, names) if part)
