"""What a task waits for in the end: from wait to wait until something waits for nothing else. Asks what was known.

Each task is looked at once a moment, however many wait for it, and nothing recurses.
"""

from collections import Counter, deque
from collections.abc import Iterator
from heapq import merge
from itertools import groupby, islice
from typing import NamedTuple

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import OVER, State
from tca_tools.why.leads import Kind, Node, is_delay, leads, next_of
from tca_tools.why.waiting import blockers_of, of_blocker, waits_how, why_waiting
from tca_tools.why.whereabouts import not_answered
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import by_whom, place

MOST = 100
"""Ends of one task that are told apart."""
_NAMED = 3
_TOLD = 20
"""Things that many wait for."""
_NO_WAITS = (Kind.GOES_ON, Kind.WATCHES)
"""What is no wait where it is the task's own."""


class End(NamedTuple):
    """What waits for nothing else. Ends sort by what is told first."""

    rank: int
    """The value of its Kind."""
    number: int
    """The message, task or lock; of a circle the first one in it."""

    @property
    def kind(self) -> Kind:
        """Why it waits for nothing else."""
        return Kind(self.rank)


class Cause(NamedTuple):
    """Something that tasks wait for in the end."""

    text: str
    tasks: int
    """How many wait for it."""
    number: int
    """The task or message to look at."""


class Ends:
    """The ends of all waits at a moment."""

    def __init__(self, at: RunAt) -> None:
        self._at = at
        self._ends: dict[Node, tuple[End, ...]] = {}
        self._circles: dict[int, list[int]] = {}
        """By the first one in it."""
        self.last: set[End] = set()
        """All ends that something else has been found to wait for."""

    @classmethod
    def at(cls, at: RunAt) -> "Ends":
        """Those of a moment, as far as they have been looked for already."""
        found: Ends = at.memo.setdefault(cls, cls(at))
        return found

    def of(self, number: int, within: int | None = None) -> tuple[End, ...]:
        """What something waits for in the end: the first ``MOST``, and one more if there are more. Itself, if it waits
        for nothing that has a number; nothing, if there are more than so many waits *within* which it was looked for.
        """
        return self.of_node(next_of(self._at, number), within)

    def of_node(self, node: Node, within: int | None = None) -> tuple[End, ...]:
        """The same of who waits for this."""
        deque(self.looking(node, within), maxlen=0)
        return self._ends.get(node, ())

    def looking(self, node: Node, within: int | None = None) -> Iterator[None]:
        """Find them bit by bit: between two bits others may look for others, and the run may go on."""
        if node not in self._ends and within != 0:
            for group in _Walk(self._at, self._ends).groups(node, within):
                if group:
                    self._settle(group)
                yield

    def circle(self, number: int) -> list[int]:
        """All that wait for each other in a circle, by its first."""
        return self._circles[number]

    def _settle(self, group: "_Group") -> None:
        """What waits for each other, or one thing alone, has the ends of all that it waits for elsewhere."""
        found: dict[int, tuple[End, ...]] = {}
        numbers = {one.number for one in group.together}
        for other in group.beyond:
            if (known := self._ends.get(other)) is not None:
                found[id(known)] = known
                if known[0].number == other.number and other.number not in numbers:
                    self.last.add(known[0])
        if group.own:
            found[0] = tuple(sorted(group.own))
        elif not found:
            members = sorted(numbers)
            self._circles[members[0]] = members
            found[0] = (End(Kind.CIRCLE.value, members[0]),)
        several = merge(*found.values())
        only = next(iter(found.values())) if len(found) == 1 else None  # as a rule
        ends = only or tuple(islice((end for end, _ in groupby(several)), MOST + 1))
        for one in group.together:
            self._ends[one] = ends


class _Group(NamedTuple):
    """Those that wait for each other, or one alone."""

    together: list[Node]
    beyond: list[Node]
    """All that they wait for."""
    own: set[End]
    """Why some of them wait for themselves, too."""


class _Walk:
    """From wait to wait, depth first, to where something waits for nothing else (Tarjan's algorithm, without recursion:
    what waits for each other is found together).
    """

    def __init__(self, at: RunAt, ends: dict[Node, tuple[End, ...]]) -> None:
        self._at, self._ends = at, ends
        self._order: dict[Node, int] = {}
        """When each was come to."""
        self._lowest: dict[Node, int] = {}
        """For each the first one, in that order, that it leads back to."""
        self._open: list[Node] = []
        """Those that have not been given ends yet."""
        self._way: list[tuple[Node, Iterator[Node]]] = []
        self._further: dict[Node, list[Node]] = {}
        self._own: dict[Node, list[Kind]] = {}

    def groups(self, start: Node, within: int | None) -> Iterator[_Group | None]:
        """Each that is found; who comes later waits for those before. By then they must have been given their ends.
        None any more, once more than so many waits have been looked at. None stands for a step on the way.
        """
        self._enter(start)
        while self._way and (within is None or len(self._order) <= within):
            one, rest = self._way[-1]
            if self._goes_on(one, rest):
                yield None
                continue
            self._way.pop()
            if self._way:
                above, _ = self._way[-1]
                self._lowest[above] = min(self._lowest[above], self._lowest[one])
            if self._lowest[one] == self._order[one]:
                yield self._group(one)

    def _group(self, first: Node) -> _Group:
        together = [self._open.pop()]
        while together[-1] != first:
            together.append(self._open.pop())
        own = {End(kind.value, one.number) for one in together for kind in self._own.pop(one, ())}
        return _Group(together, [other for member in together for other in self._further.pop(member)], own)

    def _goes_on(self, one: Node, rest: Iterator[Node]) -> bool:
        """Whether it leads to something that has not been looked at."""
        for other in rest:
            if other in self._ends:
                continue
            if other in self._order:
                self._lowest[one] = min(self._lowest[one], self._order[other])
                continue
            self._enter(other)
            if other not in self._ends:
                return True
        return False

    def _enter(self, one: Node) -> None:
        further, kinds = leads(self._at, one)
        if not further:
            self._ends[one] = tuple(sorted(End(kind.value, one.number) for kind in kinds))
            return
        if kinds:
            self._own[one] = kinds
        self._order[one] = self._lowest[one] = len(self._order)
        self._open.append(one)
        self._further[one] = further
        self._way.append((one, iter(further)))


class Last(NamedTuple):
    """What a task waits for in the end, in its parts: ``for paint {3}, which no module handles, and for 1 other``."""

    thing: str
    which: str
    """Why it waits for nothing else, to be said behind its name: "no module handles", "is suspended"."""
    that: str
    """The same as a sentence of its own: "no module handles that", "that is suspended"."""
    others: str = ""
    """How many others there are: ", and for 2 others"."""

    def __str__(self) -> str:
        return f"for {self.thing}, which {self.which}{self.others}"

    @property
    def behind(self) -> str:
        """What is said behind its name: "no module handles that; in the end also for 2 others"."""
        return f"{self.that}; in the end also {self.others.removeprefix(', and ')}" if self.others else self.that


def in_the_end(at: RunAt, task: TaskAt) -> str:
    """What a task waits for in the end: ``for calibrate {343}, which no module handles``; "" if it waits for nothing
    else, or if ``why_waiting`` says as much.
    """
    return str(last_of(at, task) or "")


def last_of(at: RunAt, task: TaskAt, within: int | None = None) -> Last | None:
    """The same in its parts; None, too, if it is not found *within* so many waits."""
    ends = () if task.state in OVER else Ends.at(at).of(task.id, within)
    if ends and ends[0].kind is not Kind.CIRCLE:
        ends = tuple(end for end in ends if end.number != task.id)
    if not ends or _is_told(at, task, ends):
        return None
    more = len(ends) - 1
    others = (
        ""
        if not more
        else f", and for {more} other{'s' * (more > 1)}"
        if more < MOST
        else f", and for {MOST} or more others"
    )
    return of_end(at, ends[0])._replace(others=others)


def _is_told(at: RunAt, task: TaskAt, ends: tuple[End, ...]) -> bool:
    """Whether each is what it waits for next, and no more is to be said of it than is said there."""
    nexts, _ = leads(at, next_of(at, task.id))
    for claim in [at.run.claims[one.number] for one in nexts if one.number in at.run.claims]:
        if at.is_granted(claim) or claim.by is task.handling:  # who has it is told, or what keeps the task from it
            nexts += leads(at, Node(claim.id))[0]
    told = {one.number for one in nexts}
    return told >= {end.number for end in ends} and all(_is_plain(at, task, end) for end in ends)


def _is_plain(at: RunAt, task: TaskAt, end: End) -> bool:
    if end.kind is Kind.SUSPENDED:
        return task.state is State.SUSPENDED
    is_unknown = end.kind is Kind.STANDS and end.number in at.tasks and not why_waiting(at, TaskId(end.number))
    return is_unknown or end.kind is Kind.GOES_ON or end.number not in at.tasks


def of_end(at: RunAt, end: End) -> Last:
    """One of them, with why it waits for nothing else: ``for move {4}, which controller handles``."""
    if (claim := at.run.claims.get(end.number)) is not None:
        does = f"{claim.sender} {'has' if at.is_granted(claim) else 'waits for'}"
        return Last(f"the {claim}", does, f"{does} that")
    thing = at.describe(end.number)
    if does := "no module handles" if end.kind is Kind.NOBODY else _by_whom(at, end):
        return Last(thing, does, f"{does} that")
    which = _not_answered(at, end)
    return Last(thing, which, which) if which else Last(thing, which := _which(at, end), f"that {which}")


def _which(at: RunAt, end: End) -> str:
    task = at.tasks.get(end.number)
    if end.kind is Kind.CIRCLE:
        members = Ends.at(at).circle(end.number)
        others = [at.describe(one) for one in members if one != end.number]
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        return f"waits for itself by way of {', '.join(others[:_NAMED])}{more}"
    if end.kind is Kind.SUSPENDED and task and task.suspension:
        by = task.suspension.by
        return f"is suspended{by_whom(by)}"
    if task and (reasons := _reasons(at, task, end)):
        how = "is killed, but" if task.state is State.ENDING else waits_how(task)
        return f"{how} {', and '.join(reasons)}"
    return f"is {task.standing}" if task else "has not been answered"


def _by_whom(at: RunAt, end: End) -> str:
    """Who handles it, where that goes on."""
    message = at.run.messages.get(end.number)
    is_of_one = message and end.kind is Kind.GOES_ON and not message.message_class.asks_many
    run = at.handling_of(message) if message and is_of_one else None
    return f"{place(run.module, run.resource)} handles" if run else ""


def _not_answered(at: RunAt, end: End) -> str:
    """Who has not answered it, if it was asked of many."""
    message = at.run.messages.get(end.number)
    is_of_many = message and message.message_class.asks_many and end.kind is not Kind.CIRCLE
    return not_answered(at, message) if message and is_of_many else ""


def _reasons(at: RunAt, task: TaskAt, end: End) -> list[str]:
    if end.kind is Kind.DELAYED:  # of any of its moments
        held = blockers_of(at, task, [moment for moment in Moment if moment not in task.reached])
        return list(dict.fromkeys(of_blocker(at, task, one) for one in held if is_delay(at, one)))
    return why_waiting(at, task.id)


def causes(at: RunAt) -> tuple[int, int, list[Cause]]:
    """How many tasks wait, for how many things in the end, and the things that most of them wait for. What nobody
    handles counts once a name; a task counts for its first ``MOST`` ends.
    """
    count = Count(at)
    deque(count.steps(), maxlen=0)
    return count.causes()


class Count:
    """The same, counted bit by bit: of a hundred thousand tasks it takes a while."""

    def __init__(self, at: RunAt) -> None:
        self._at, self._ends = at, Ends.at(at)
        self._waiting = Counter[tuple[End, ...]]()
        self._first: dict[End, int] = {}

    def steps(self) -> Iterator[None]:
        """Count. Between two bits the run may go on, and others may look."""
        for task in list(self._at.tasks.values()):
            if task.state not in OVER:
                node = next_of(self._at, task.id)
                yield from self._ends.looking(node)
                found = self._ends.of_node(node)
                if found[0].number != task.id or found[0].kind not in _NO_WAITS:
                    self._waiting[found] += 1
                    self._first.setdefault(found[0], task.id)
            yield

    def causes(self) -> tuple[int, int, list[Cause]]:
        """What the function of that name returns, when all has been counted."""
        at = self._at
        things: dict[object, list[End]] = {}
        counts: Counter[object] = Counter()
        for found, tasks in self._waiting.items():
            named = {_thing(at, end): end for end in reversed(found)}
            for thing, end in named.items():
                things.setdefault(thing, []).append(end)
                counts[thing] += tasks
        ranked = sorted(things, key=lambda thing: (-counts[thing], min(things[thing])))[:_TOLD]
        told = [_cause(at, things[thing], counts[thing], self._first) for thing in ranked]
        return sum(self._waiting.values()), len({*things, *(_thing(at, end) for end in self._ends.last)}), told


def _thing(at: RunAt, end: End) -> object:
    return at.run.name(end.number) if end.kind is Kind.NOBODY else end


def _cause(at: RunAt, ends: list[End], tasks: int, first: dict[End, int]) -> Cause:
    end = min(ends)
    text = str(of_end(at, end)).removeprefix("for ")
    if len(set(ends)) > 1:  # messages of one name
        text = f"{at.run.name(end.number)}, which no module handles"
    is_lock = end.number in at.run.claims
    return Cause(text, tasks, first.get(end, end.number) if is_lock else end.number)
