"""The ends of all waits of a run at a moment, and what most of its tasks wait for."""

from collections import Counter
from itertools import islice
from typing import NamedTuple

from tca_tools.explain.graph import next_node, steps
from tca_tools.explain.waits import Node
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import OVER
from tca_wire.waits import WaitKind
from tca_wire.waits import ends as walker

_TOLD = 20
"""Things that many wait for."""
_RANKS = (
    WaitKind.CIRCLE, WaitKind.HANDLER, WaitKind.RESUME, WaitKind.LOCKED, None, WaitKind.DELAY, WaitKind.PRESENCE,
    WaitKind.CHANGE, WaitKind.RUNNING, WaitKind.CONDITION,
)  # fmt: skip
"""Why something waits for nothing else, in the order in which it is told: what stands first, monitors that watch last.
None: for something that the journal does not tell.
"""
_RANK = {kind: rank for rank, kind in enumerate(_RANKS)}


class End(NamedTuple):
    """The end of a chain of waits: it waits for nothing else. Ends sort by what is told first."""

    rank: int
    """The place of its kind among ``_RANKS``."""
    number: int
    """The message, task or lock; of a circle the first one in it."""

    @property
    def kind(self) -> WaitKind | None:
        """Why it waits for nothing else (None: the journal does not tell)."""
        return _RANKS[self.rank]

    @property
    def goes_on(self) -> bool:
        """Whether it is no wait where it is the task's own: it runs, or watches."""
        return self.kind in (WaitKind.RUNNING, WaitKind.CONDITION)


class Cause(NamedTuple):
    """Something that tasks wait for in the end."""

    ends: tuple[End, ...]
    """It; several, of messages of one name that nobody handles."""
    tasks: int
    """How many wait for it."""
    first: int
    """The first task that does."""


class Ends:
    """The ends of all waits at a moment."""

    def __init__(self, at: RunAt) -> None:
        self._at = at
        self._walk: walker.Ends[Node, End] = walker.Ends(self)
        self._left: int | None = None
        """The number of waits that may be looked at (None: all)."""
        self._awaited: set[Node] = set()
        """All that something else waits for."""

    @classmethod
    def at(cls, at: RunAt) -> "Ends":
        """Those of a moment, as far as they have been looked for already."""
        found: Ends = at.memo.setdefault(cls, cls(at))
        return found

    def of(self, number: int, within: int | None = None) -> tuple[End, ...]:
        """The ends of a message's waits: the first ``MOST``, and one more if there are more. Itself, if it waits for
        nothing that has a number; nothing, if there are more than so many waits *within* which it was looked for.
        """
        return self.of_node(next_node(self._at, number), within)

    def of_node(self, node: Node, within: int | None = None) -> tuple[End, ...]:
        """The ends of the waits of any node."""
        self._left = within
        try:
            return self._walk.of(node)
        except walker.TooFarError:
            return ()

    def steps(self, node: Node) -> tuple[list[Node], list[End]]:
        """One step of the walk."""
        if self._left is not None:
            self._left -= 1
            if self._left < 0:
                raise walker.TooFarError
        nexts, leaves = steps(self._at, node)
        self._awaited.update(nexts)
        if nexts and not leaves:
            return nexts, []
        return nexts, [End(_RANK[kind], node.number) for kind in leaves or (None,)]

    @staticmethod
    def circle(nodes: list[Node]) -> End:
        """The end of those that wait for each other."""
        return End(_RANK[WaitKind.CIRCLE], min(node.number for node in nodes))

    def members(self, circle: End) -> list[int]:
        """All that wait for each other in a circle."""
        return sorted({node.number for node in self._walk.circles[circle]})

    def last(self) -> set[End]:
        """All ends that something else has been found to wait for."""
        known = ((to.number, self._walk.known[to][0]) for to in self._awaited if to in self._walk.known)
        return {end for number, end in known if end.number == number}


def causes(at: RunAt) -> tuple[int, int, list[Cause]]:
    """How many tasks wait, for how many things in the end, and the things that most of them wait for. What nobody
    handles counts once a name; a task counts for its first ``MOST`` ends.
    """
    ends = Ends.at(at)
    waiting: dict[int, tuple[tuple[End, ...], list[int]]] = {}
    for task in islice(at.run.tasks.values(), len(at.tasks)):
        if task.state_at(at.moment) not in OVER:
            found = ends.of(task.id)
            if found[0].number != task.id or not found[0].goes_on:
                if id(found) not in waiting:  # as they are all kept
                    waiting[id(found)] = found, []
                waiting[id(found)][1].append(task.id)
    first: dict[End, int] = {}
    things: dict[object, list[End]] = {}
    counts: Counter[object] = Counter()
    for found, tasks in waiting.values():
        first[found[0]] = min(tasks[0], first.get(found[0], tasks[0]))
        for thing, end in {_thing(at, end): end for end in reversed(found)}.items():
            things.setdefault(thing, []).append(end)
            counts[thing] += len(tasks)
    ranked = sorted(things, key=lambda thing: (-counts[thing], min(things[thing])))[:_TOLD]
    told = [tuple(sorted(set(things[thing]))) for thing in ranked]
    return (
        sum(len(tasks) for _, tasks in waiting.values()),
        len({*things, *(_thing(at, end) for end in ends.last())}),
        [Cause(one, counts[thing], first.get(one[0], one[0].number)) for one, thing in zip(told, ranked, strict=True)],
    )


def _thing(at: RunAt, end: End) -> object:
    return at.run.name(end.number) if end.kind is WaitKind.HANDLER else end
