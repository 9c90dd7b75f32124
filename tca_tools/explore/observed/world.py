"""The world that properties of a scenario see after an action: that of ``tca check``, without ids,
ages and times.

States that differ only in ids, orders and absolute times are explored once, so properties may see
none of that:
messages come in an order that the state gives, not by age, and ids can only be compared. A property
that looks at the time makes it part of the state.
"""

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import NoReturn

import msgspec

from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_tools.properties.algebra import Breach
from tca_tools.properties.world import Found, MessageView, Predicate
from tca_wire.points import Moment

_DIGITS = 6  # of seconds


class Name:
    """Says which message is meant, and nothing else: an id is another number in each run."""

    __slots__ = ("_number",)

    def __init__(self, number: int) -> None:
        self._number = number

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Name):
            self._refuse()
        return self._number == other._number

    def __hash__(self) -> int:
        return 0  # that of the number would show in the order of sets

    def __repr__(self) -> str:
        return "an id"

    def _refuse(self, *_: object) -> NoReturn:
        raise TypeError(
            "an id is another number in each run: it can be compared with other ids (==) and nothing else; "
            "world.parent(task) and world.children(task) give relatives"
        )

    __lt__ = __le__ = __gt__ = __ge__ = __int__ = __index__ = __float__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __mod__ = __bool__ = __format__ = _refuse


SEEN = tuple(MessageView.__annotations__)
"""What properties see of the record of a message; ids come as names."""
_FETCH = attrgetter(*SEEN)


class Seen(MessageView):
    """A message under way: a task of the tree, or a query, an inform, or one copy of a broadcast or
    multi-query.
    """

    def __init__(self, record: MessageRecord) -> None:
        vars(self).update(zip(SEEN, _FETCH(record), strict=True))
        self.id, self.parent_id = Name(record.id), Name(record.parent_id)
        self.about = Name(record.about)
        """Where central sent it: the failing, tapped, killed or monitoring task."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Seen) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(self.id)

    def __str__(self) -> str:
        return self.message


class AcceptedRequest(msgspec.Struct, frozen=True):
    """A request that central has taken."""

    sender: str
    """The module that asked."""
    call: str
    """The call of the module library by which it did: "kill", "on_termination", ..."""


class Held(msgspec.Struct, frozen=True):
    """A lock or reservation in force."""

    module: str
    resource: str
    sender: str
    """The module that has it."""
    is_reserved: bool


class Messages:
    """Some messages, in an order that means nothing: what is older can't be told. Iterate, count,
    or look for one.
    """

    def __init__(self, seen: list[Seen]) -> None:
        self._seen = seen

    def __iter__(self) -> Iterator[Seen]:
        return iter(self._seen)

    def __len__(self) -> int:
        return len(self._seen)

    def __contains__(self, seen: object) -> bool:
        return any(seen is one or seen == one for one in self._seen)

    def __getitem__(self, place: object) -> NoReturn:
        raise TypeError(
            "messages have no order here: choose by what they are, as in [task for task in world.tasks if "
            "task.message == 'walk']"
        )


class World:
    """The messages under way. What ended with the last action is still there; what ended before is
    not.
    """

    def __init__(
        self,
        known: JournalWorld,
        order: dict[int, int],
        taken: AcceptedRequest | None = None,
        on_time_read: Callable[[], None] = lambda: None,
    ) -> None:
        self._known = known
        self.taken = taken
        """The request of a script that central took with the last action; None if there was none,
        or it was refused or too late.
        """
        self._on_time_read = on_time_read  #: called when somebody looks at the time
        # Messages from before the last action come in the order of the state before it; the rest as
        # they were sent.
        keys = sorted(known.items, key=lambda key: (key not in order, order.get(key, key)))
        self._seen = {key: Seen(known.items[key]) for key in keys}

    def true_of(self, predicate: Predicate) -> Found:
        """The value of a predicate."""
        return Found.of(predicate(self))

    newly = (
        true_of  # whatever is true of what ended or came with the last action is so for this one
    )

    @property
    def messages(self) -> Messages:
        """Everything under way."""
        return Messages(list(self._seen.values()))

    @property
    def tasks(self) -> Messages:
        """The tasks among them."""
        return Messages([seen for seen in self._seen.values() if seen.is_task])

    def parent(self, task: Seen) -> Seen | None:
        """The task that *task* is under; None: the root."""
        return next((seen for seen in self._seen.values() if seen.id == task.parent_id), None)

    def children(self, task: Seen) -> Messages:
        """The tasks under *task*."""
        return Messages(
            [seen for seen in self._seen.values() if seen.is_task and seen.parent_id == task.id]
        )

    def held(self, task: Seen) -> list[tuple[Moment, Moment, Seen | None]]:
        """The constraints on *task*: which of its moments comes no sooner than which moment of
        which task (None: one that has ended). Those with a delay are not among them.
        """
        of = {seen.id: key for key, seen in self._seen.items()}
        held = [
            hold.constraint for hold in self._known.items[of[task.id]].holds if hold.due is None
        ]
        return [
            (one.after.moment, one.before.moment, self._seen.get(one.before.task))
            for one in held
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
        """The modules that are connected, by name."""
        return tuple(sorted(self._known.modules))

    @property
    def passed(self) -> float:
        """Seconds that passed with the last action."""
        return round(self._known.passed, _DIGITS)

    @property
    def now(self) -> float:
        """Seconds since the run began. A property that looks at it makes each time another state,
        and a scenario in which time never stops endless: ``within`` does not.
        """
        self._on_time_read()
        return round(self._known.now, _DIGITS)


def describe_breach(breach: Breach) -> str:
    """The error in words, and its messages with their ids."""
    names = ", ".join(
        f"{one.message} {{{int(one.id._number)}}}" if isinstance(one, Seen) else str(one)  # noqa: SLF001
        for one in breach.messages
    )
    return ": ".join(part for part in (breach.what, names) if part)
