"""The ends of waits: from wait to wait until something waits for nothing else.

Each node is looked at once a moment, however many wait for it, and nothing recurses.
"""

from collections import Counter
from collections.abc import Iterator
from heapq import merge
from itertools import groupby, islice
from typing import NamedTuple

from tca_tools.explain.wait import Node
from tca_tools.explain.waits import next_node, steps
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import OVER
from tca_wire.waits import WaitKind

MOST = 100
"""Ends of one task that are told apart."""
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
        self._ends: dict[Node, tuple[End, ...]] = {}
        self._circles: dict[int, list[int]] = {}
        """All that wait for each other in a circle, by the first."""
        self.last: set[End] = set()
        """All ends that something else has been found to wait for."""

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
        if node not in self._ends and within != 0 and not self._is_plain(node, *steps(self._at, node)):
            self._follow(node, within)
        return self._ends.get(node, ())

    def _is_plain(self, node: Node, nexts: list[Node], leaves: list[WaitKind]) -> bool:
        """Whether a node waits for one thing only, of which the ends are known: then it has the same."""
        if len(nexts) != 1 or leaves or (found := self._ends.get(nexts[0])) is None:
            return False
        self._ends[node] = found
        if found[0].number == nexts[0].number != node.number:
            self.last.add(found[0])
        return True

    def _follow(self, start: Node, within: int | None) -> None:
        """Go on as long as each waits for one thing only, as in a long chain; from there on search."""
        ends, node = self._ends, start
        chain: dict[Node, None] = {}
        while node not in ends and node not in chain and (within is None or len(chain) < within):
            nexts, leaves = steps(self._at, node)
            if leaves or len(nexts) != 1:
                break
            chain[node] = None
            node = nexts[0]
        if node in chain:  # a circle
            self._find(start, within)
            return
        if node not in ends:
            self._find(node, None if within is None else within - len(chain))
        for one in reversed(chain) if node in ends else ():
            self._is_plain(one, [node], [])
            node = one

    def circle(self, number: int) -> list[int]:
        """All that wait for each other in a circle, by its first."""
        return self._circles[number]

    def _find(self, start: Node, within: int | None) -> None:
        """Go depth first to where something waits for nothing else; what waits for each other is found together
        (Tarjan's algorithm, without recursion).
        """
        ends, order, lowest = self._ends, dict[Node, int](), dict[Node, int]()
        undecided: dict[Node, tuple[list[Node], list[WaitKind]]] = {}
        way: list[tuple[Node, list[Node], Iterator[Node]]] = [(start, [], iter([start]))]
        while way:
            node, further, rest = way[-1]
            for new in rest:
                if new in order or new in ends:
                    continue
                if within is not None and len(order) > within:
                    return
                order[new] = lowest[new] = len(order)
                nexts, leaves = steps(self._at, new)
                if not self._is_plain(new, nexts, leaves):
                    undecided[new] = nexts, leaves
                    way.append((new, nexts, iter(nexts)))
                    break
            else:
                way.pop()
                lowest[node] = min([lowest[node], *(lowest[one] for one in further if one not in ends)])
                if lowest[node] == order[node] and node in undecided:
                    self._settle(undecided, node)

    def _settle(self, undecided: dict[Node, tuple[list[Node], list[WaitKind]]], first: Node) -> None:
        """Give each circle of waits, or single node, the ends of all that it waits for elsewhere."""
        group = dict([undecided.popitem()])
        while first not in group:
            group.update([undecided.popitem()])
        several = self._beyond(group)
        if not several:
            numbers = sorted({node.number for node in group})
            self._circles[numbers[0]] = numbers
            several = [(End(_RANK[WaitKind.CIRCLE], numbers[0]),)]
        ends = several[0]
        if len(several) > 1:
            ends = tuple(islice((end for end, _ in groupby(merge(*several))), MOST + 1))
        for node in group:
            self._ends[node] = ends

    def _beyond(self, group: dict[Node, tuple[list[Node], list[WaitKind]]]) -> list[tuple[End, ...]]:
        """The ends of all that a group waits for elsewhere, and its own."""
        numbers = {node.number for node in group}
        own: set[End] = set()
        several: dict[int, tuple[End, ...]] = {}
        for node, (nexts, leaves) in group.items():
            if leaves or not nexts:
                own.update(End(_RANK[leaf], node.number) for leaf in leaves or (None,))
            for to in nexts:
                if (known := self._ends.get(to)) is not None:
                    several[id(known)] = known
                    if known[0].number == to.number and to.number not in numbers:
                        self.last.add(known[0])
        return [*several.values(), *([tuple(sorted(own))] if own else [])]


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
        len({*things, *(_thing(at, end) for end in ends.last)}),
        [Cause(one, counts[thing], first.get(one[0], one[0].number)) for one, thing in zip(told, ranked, strict=True)],
    )


def _thing(at: RunAt, end: End) -> object:
    return at.run.name(end.number) if end.kind is WaitKind.HANDLER else end
