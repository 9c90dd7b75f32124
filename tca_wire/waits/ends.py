"""The ends of waits: follow waits until something waits for nothing else.

Central's state and a run at one instant both offer their waits as a graph. The search visits each
node once, however many others wait for the node, and does not recurse.
"""

from collections.abc import Iterator, Sequence
from heapq import merge
from itertools import groupby, islice
from typing import Any, Generic, Protocol, TypeVar

MOST = 100
"""The number of ends that are listed for one node."""

NodeT = TypeVar("NodeT")
EndT_co = TypeVar("EndT_co", covariant=True)


class TooFarError(Exception):
    """A limit of the search is reached. The ends found so far remain known."""


class WaitGraph(Protocol[NodeT, EndT_co]):
    """A graph of waits."""

    def steps(self, node: NodeT) -> tuple[Sequence[NodeT], Sequence[EndT_co]]:
        """Return the nodes that a node waits for, and its own ends, which wait for nothing."""

    def circle(self, nodes: list[NodeT]) -> EndT_co:
        """Return the end of nodes that wait for each other, and for nothing else."""


class Ends(Generic[NodeT, EndT_co]):
    """The ends of the waits of a graph, computed on demand."""

    def __init__(self, graph: WaitGraph[NodeT, EndT_co]) -> None:
        self._graph = graph
        self.known: dict[NodeT, tuple[EndT_co, ...]] = {}
        self.circles: dict[EndT_co, list[NodeT]] = {}
        """The nodes of each cycle that was found."""

    def of(self, node: NodeT) -> tuple[EndT_co, ...]:
        """Return the sorted ends of a node: the first ``MOST``, and one more if there are more."""
        known, start = self.known, node
        if (ends := known.get(start)) is not None:
            return ends
        chain: dict[NodeT, None] = {}
        # A chain, in which each node waits for one other, has one end: it needs no search.
        while node not in known:
            successors, own = self._graph.steps(node)
            if node in chain or len(successors) + len(own) != 1:
                self._find(node)
            elif own:
                known[node] = (own[0],)
            else:
                chain[node] = None
                node = successors[0]
        known.update(dict.fromkeys(chain, known[node]))
        return known[start]

    def _find(self, start: NodeT) -> None:
        """Search depth first for ends; nodes that wait for each other are found together.

        This is Tarjan's algorithm for strongly connected components, without recursion.
        """
        known, order, lowest = self.known, dict[NodeT, int](), dict[NodeT, int]()
        undecided: dict[NodeT, tuple[Sequence[NodeT], Sequence[EndT_co]]] = {}
        path: list[tuple[NodeT, Sequence[NodeT], Iterator[NodeT]]] = [(start, (), iter([start]))]
        while path:
            node, successors, rest = path[-1]
            for new in rest:
                if new in order or new in known:
                    continue
                order[new] = lowest[new] = len(order)
                new_successors, own = self._graph.steps(new)
                # The node has the same ends as its only successor, whose ends are known.
                if len(new_successors) == 1 and not own and new_successors[0] in known:
                    known[new] = known[new_successors[0]]
                    continue
                undecided[new] = new_successors, own
                path.append((new, new_successors, iter(new_successors)))
                break
            else:
                path.pop()
                lowest[node] = min(
                    [lowest[node], *(lowest[one] for one in successors if one not in known)]
                )
                if lowest[node] == order[node] and node in undecided:
                    self._record_component(undecided, node)

    def _record_component(
        self, undecided: dict[NodeT, tuple[Sequence[NodeT], Sequence[EndT_co]]], first: NodeT
    ) -> None:
        """Record the ends of a cycle of waits, or of a single node.

        They are the nodes' own ends, and the ends of everything outside that the nodes wait for.
        """
        group = dict([undecided.popitem()])
        while first not in group:
            group.update([undecided.popitem()])
        own: set[Any] = {end for _, ends in group.values() for end in ends}
        beyond = (
            self.known[node]
            for successors, _ in group.values()
            for node in successors
            if node in self.known
        )
        # Nodes share tuples of ends: merging each tuple once, by its identity, is much cheaper.
        to_merge: list[Any] = [*{id(ends): ends for ends in beyond}.values()]
        if own:
            to_merge.append(tuple(sorted(own)))
        if not to_merge:
            end = self._graph.circle([*group])
            self.circles[end] = [*group]
            to_merge = [(end,)]
        ends = to_merge[0]
        if len(to_merge) > 1:
            ends = tuple(islice((end for end, _ in groupby(merge(*to_merge))), MOST + 1))
        self.known.update(dict.fromkeys(group, ends))
