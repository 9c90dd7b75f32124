"""A search through the graph of needs for nodes that can never come about. It can be interrupted.

Theory of operation. A node is *live* if each group that it needs has a live node. All other nodes
are *stuck*. The search goes forwards from the node in question. Each visited node stands at its
first group without a known live node. When a node of that group becomes live, the visited node
moves to its next group. After its last group, the visited node is live itself. When no node can
move, the visited nodes that are not live are stuck. Results are reused for later questions.

An interrupted search has seen different parts of the graph at different times. It still finds all
nodes that were stuck when it began. A stuck node stays stuck, because one of its groups contains
only stuck nodes. Nor does the search call a live node stuck. Before it calls a node stuck, it
checks once more the groups at which the nodes stand. That check is not interrupted.
"""

from collections.abc import Iterable

from tca_central.needs.graph import (
    Group,
    Groups,
    Node,
    Turn,
    TurnAt,
    is_only_queued,
    needs,
    still_needs,
)
from tca_central.order.cycles import Each, Place
from tca_central.state import State


class TooLongError(Exception):
    """The search may visit no further edge, and has no result yet."""


class Search:
    """A search for stuck nodes that visits at most *edges* edges.

    With ``list`` for *each* the search may continue after other events.
    """

    def __init__(self, central: State, edges: int, each: Each = iter) -> None:
        self.edges = edges  #: number of edges that it may still visit
        self._central = central
        self._each = each
        self._is_old = False  #: whether anything may have changed since it began
        self._live: set[Node | int] = set()  #: keys of live nodes
        #: Nodes not known to be live, each with its remaining groups.
        self._open: dict[Node, Groups] = {}
        self._at: dict[Node, Group] = {}  #: the group at which an open node stands
        #: By node: the open nodes that stand at a group with that node, and the group.
        self._users: dict[Node, list[tuple[Node, Group]]] = {}
        self._to_do: list[Node] = []  #: open nodes that can continue; the last one is next

    @property
    def is_under_way(self) -> bool:
        """Whether there are nodes left to visit."""
        return bool(self._to_do)

    def restarted(self) -> "Search":
        """Return an empty search with the edges that this one has left."""
        return Search(self._central, self.edges, self._each)

    def resume(self, edges: int) -> None:
        """Continue after other events, with that number of edges."""
        self.edges = edges
        self._is_old = True

    def is_stuck(self, node: Node) -> bool:
        """Whether a node can never come about. Raises TooLongError if the edges do not suffice."""
        while True:
            if _key(node) in self._live:
                return False
            self._open_new([node])
            self._walk(node)
            if node not in self._open:
                return False
            if not self._is_old or self._confirm(node):
                return True

    def cycle(self, start: Node) -> list[Node]:
        """Return a cycle to which *start*, a stuck node, leads. Each node needs the next."""
        trail: dict[Node, int] = {}
        node = start
        while node not in trail:
            trail[node] = len(trail)
            node = self._at[node][0]
        return list(trail)[trail[node] :]

    def count_edge(self) -> None:
        """Count one edge. Raises TooLongError if none is left."""
        if self.edges <= 0:
            raise TooLongError
        self._count(1)

    def _count(self, edges: int) -> None:
        """Count edges of a group, which is always visited as a whole."""
        self.edges -= edges

    def _open_new(self, nodes: Iterable[Node]) -> None:
        """Open nodes that were not visited before."""
        for node in nodes:
            if node not in self._open:
                self._open[node] = needs(self._central, node, self._each)
                self._to_do.append(node)

    def _walk(self, goal: Node) -> None:
        """Visit nodes until it is known whether *goal* is live."""
        while self._to_do and goal in self._open:
            node = self._to_do[-1]
            group = self._next_group(node)
            self._to_do.pop()
            if group is None:
                self._mark_live(node)
                continue
            self._at[node] = group
            for needed in group:
                self._users.setdefault(needed, []).append((node, group))
            self._open_new(reversed(group))

    def _next_group(self, node: Node) -> Group | None:
        """Return the next group without a node known to be live; None after the last group."""
        groups, live = self._open[node], self._live
        while True:
            self.count_edge()
            group = next(groups, ())
            if group == ():
                return None
            if group is not None:
                self._count(len(group) - 1)
                if not any(_key(one) in live for one in group):
                    return group

    def _mark_live(self, node: Node) -> None:
        """Mark a node live, and let the nodes that stand at a group with it continue."""
        del self._open[node]
        if _is_worth_storing(node):
            self._live.add(_key(node))
        for user, group in self._users.pop(node, ()):
            if self._at.get(user) is group:
                del self._at[user]
                self._to_do.append(user)

    def _confirm(self, start: Node) -> bool:
        """Whether *start* is still stuck, when all nodes that it leads to are checked again.

        *start* is stuck if all these nodes have the same needs as before. A node whose needs have
        changed is opened again.
        """
        met, trail, changed = {start}, [start], []
        for node in trail:  # grows while it is walked
            group = self._at[node]
            self._count(len(group))
            if still_needs(self._central, node, group):
                new = [one for one in group if one not in met]
                met.update(new)
                trail += new
            else:
                changed.append(node)
        for node in changed:
            del self._open[node], self._at[node]
            self._open_new([node])
        return not changed


def _key(node: Node) -> Node | int:
    """Return the key of a live node.

    The key of a point is a number. There may be millions of points, and a number is small.
    """
    return node.task.id << 6 | node.moment if isinstance(node, Place) else node


def _is_worth_storing(node: Node) -> bool:
    """Whether to store that a node is live.

    The nodes of tasks that are only queued are not worth it. There are many, and visiting one again
    costs little.
    """
    if isinstance(node, Place):
        return not is_only_queued(node.task)
    return not isinstance(node, Turn | TurnAt)
