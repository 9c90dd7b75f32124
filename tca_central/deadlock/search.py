"""A search through the graph of needs for nodes that can never come about. It can be interrupted,
and goes on later.

Theory of operation. A node is *live* if each group that it needs holds a live node; all others are
*stuck*. The search goes forwards from the node that is asked about. Each node that it meets stands
at its first group without a known live node, and goes on to the next group when one becomes live;
after the last group it is live itself. When nothing moves any more, what is not live is stuck. What
was found is used for all that is asked later.

A search that was interrupted has seen different parts at different times. What was stuck when it
began is found all the same: it stays stuck, since one group of each such node holds such nodes
alone, and none of them is ever taken for live. What it calls stuck is stuck: before it says so, it
looks again, at once, at the groups where these nodes stand.
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
    """The search has looked at as many edges as it may, and has found nothing yet."""


class Search:
    """A search for stuck nodes over at most *edges* edges; with ``list`` for *each* it may go on
    after events.
    """

    def __init__(self, central: State, edges: int, each: Each = iter) -> None:
        self.edges = edges  #: that it may still look at
        self.looked_at = 0  #: so many edges, in all
        self._central = central
        self._each = each
        self._is_old = False  #: something may have changed since it began
        self._live: set[Node | int] = set()  #: keys of nodes
        self._open: dict[
            Node, Groups
        ] = {}  #: nodes that are not known to be live, and the groups still to come
        self._at: dict[Node, Group] = {}  #: the group at which such a node stands
        self._users: dict[
            Node, list[tuple[Node, Group]]
        ] = {}  #: by node, the users that wait for a group with it
        self._to_do: list[Node] = []  #: open nodes that can go on, the one to be seen to next last

    @property
    def is_under_way(self) -> bool:
        """Whether there is something left to look at."""
        return bool(self._to_do)

    def restarted(self) -> "Search":
        """A search that knows nothing and may look at what this one had left."""
        return Search(self._central, self.edges, self._each)

    def resume(self, edges: int) -> None:
        """After other events: so many edges more."""
        self.edges = edges
        self._is_old = True

    def is_stuck(self, node: Node) -> bool:
        """Whether a node can never come about. Raises TooLongError if that is not known yet."""
        while True:
            if _key(node) in self._live:
                return False
            self._meet([node])
            self._walk(node)
            if node not in self._open:
                return False
            if not self._is_old or self._confirm(node):
                return True

    def circle(self, start: Node) -> list[Node]:
        """A circle that *start*, which is stuck, waits for; in its order."""
        trail: dict[Node, int] = {}
        node = start
        while node not in trail:
            trail[node] = len(trail)
            node = self._at[node][0]
        return list(trail)[trail[node] :]

    def count_edge(self) -> None:
        """Raises TooLongError if nothing more may be looked at; counts one edge."""
        if self.edges <= 0:
            raise TooLongError
        self._count(1)

    def _count(self, edges: int) -> None:
        self.edges -= edges
        self.looked_at += edges

    def _meet(self, nodes: Iterable[Node]) -> None:
        for node in nodes:
            if node not in self._open:
                self._open[node] = needs(self._central, node, self._each)
                self._to_do.append(node)

    def _walk(self, goal: Node) -> None:
        """Look on until it is known whether *goal* is live."""
        while self._to_do and goal in self._open:
            node = self._to_do[-1]
            group = self._next_group(node)
            self._to_do.pop()
            if group is None:
                self._mark_live(node)
                continue
            self._at[node] = group
            for one in group:
                self._users.setdefault(one, []).append((node, group))
            self._meet(reversed(group))

    def _next_group(self, node: Node) -> Group | None:
        """The next group without a node that is known to be live; None if there is none left."""
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
        del self._open[node]
        if not _is_soon_seen_again(node):
            self._live.add(_key(node))
        for user, group in self._users.pop(node, ()):
            if self._at.get(user) is group:
                del self._at[user]
                self._to_do.append(user)

    def _confirm(self, start: Node) -> bool:
        """Whether all causes that *start* is stuck still hold; changed ones are looked at anew."""
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
            self._meet([node])
        return not changed


def _key(node: Node) -> Node | int:
    """The key of a live node: a number for points, of which there may be millions."""
    return node.task.id << 6 | node.moment if isinstance(node, Place) else node


def _is_soon_seen_again(node: Node) -> bool:
    """Whether there is no need to remember it: there is one for each task in a queue."""
    return isinstance(node, Turn | TurnAt) or (
        isinstance(node, Place) and is_only_queued(node.task)
    )
