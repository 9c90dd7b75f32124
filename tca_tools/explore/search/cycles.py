"""Runs that never end: find an event that never happens in them, or a wait that never ends.

The number of states is finite, so a run that never ends repeats a cycle of states. A cycle counts
only if it is *fair*. An unfair cycle leaves out an action that must happen some time, although this
action is possible in all states of the cycle. If such an action is possible in all states of a
strongly connected set, and always leads out of the set, then the set has no fair cycle. No part of
the set has one either.

For a property that must come true, the search covers the states in which the property is *owed*:
it has not come true yet. For ``never_stuck()`` the search follows each waiter from state to state
(``Way.new_places``). In the cycles that it finds, one task or script waits for the same thing all
the time.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from tca_tools.explore.play.play import Action, waiters
from tca_tools.explore.play.words import waiter_in_words
from tca_tools.explore.scenario.scenario import Scenario
from tca_tools.explore.search.states import SearchState, Violation, Way, replayed
from tca_tools.properties.algebra import NeverStuck, Property

Fair = tuple[str, str]
"""An action that must happen some time if it stays possible: a step of a script, of time, ..."""


class _Node(NamedTuple):
    """A state, and the place of the waiter that is followed (0 if none is)."""

    state: int
    waiter: int = 0


class _Edge(NamedTuple):
    """A way from one node to another."""

    way: Way
    to: _Node


Graph = dict[_Node, list[_Edge]]


def judge(
    scenario: Scenario, properties: Iterable[Property], states: list[SearchState]
) -> Violation | None:
    """Return the violation of the first property that a run without an end violates; else None.

    *states* are all states of the scenario, nearest first.
    """
    places = {id(state): place for place, state in enumerate(states)}
    for number, prop in enumerate(properties):
        is_stuck = isinstance(prop, NeverStuck)
        cycle = _fair_cycle(
            _waiting_graph(states, places)
            if is_stuck
            else _owed_graph(states, places, number, prop),
            states,
        )
        if cycle is None:
            continue
        start, ways = cycle
        why = "this cycle can repeat forever, and it never happens"
        if is_stuck:
            play = replayed(scenario, states[start.state])
            waiter = waiter_in_words(play, waiters(play)[start.waiter])
            why = f"this cycle can repeat forever, with this waiting throughout:\n{waiter}"
        return Violation(
            str(prop), why, states[start.state].actions(), tuple(way.action for way in ways)
        )
    return None


def _owed_graph(
    states: list[SearchState], places: dict[int, int], number: int, prop: Property
) -> Graph:
    """Return the states in which a property is owed, and the ways between them."""
    nodes = {
        _Node(place) for place, state in enumerate(states) if prop.is_owed(state.memories[number])
    }
    return {
        node: [
            _Edge(way, to)
            for way in states[node.state].ways
            if (to := _Node(places[id(way.to)])) in nodes
        ]
        for node in nodes
    }


def _waiting_graph(states: list[SearchState], places: dict[int, int]) -> Graph:
    """Return the waiters in each state, and the ways after which they still wait."""
    return {
        _Node(place, waiter): [
            _Edge(way, _Node(places[id(way.to)], way.new_places[waiter]))
            for way in state.ways
            if way.new_places[waiter] >= 0
        ]
        for place, state in enumerate(states)
        if state.ways
        for waiter in range(len(state.ways[0].new_places))
    }


def _fair_cycle(graph: Graph, states: list[SearchState]) -> tuple[_Node, list[Way]] | None:
    """Return the nearest fair cycle: its first node and its ways."""
    for part in sorted(_strongly_connected(graph), key=min):
        inside = {node: [edge for edge in graph[node] if edge.to in part] for node in part}
        happening = {_fair_key(edge.way.action) for edges in inside.values() for edge in edges}
        always = set.intersection(*(_possible(states[node.state]) for node in part))
        if happening and not always - happening:
            return min(part), _cycle_from(inside, min(part), states)
    return None


def _fair_key(action: Action) -> Fair:
    """Return the key of equal actions in different states."""
    return action.kind, action.name


def _possible(state: SearchState) -> set[Fair]:
    """Return the actions that are possible in a state and must happen some time."""
    return {_fair_key(way.action) for way in state.ways if not way.action.is_optional}


def _strongly_connected(graph: Graph) -> list[set[_Node]]:
    """Return the strongly connected components (Tarjan's algorithm, without recursion)."""
    found: list[set[_Node]] = []
    number: dict[_Node, int] = {}
    low: dict[_Node, int] = {}
    stack: list[_Node] = []
    on_stack: set[_Node] = set()
    for root in graph:
        work: list[tuple[_Node, Iterator[_Edge]]] = [] if root in number else [(root, iter(()))]
        while work:
            node, edges = work.pop()
            if node not in number:
                number[node] = low[node] = len(number)
                stack.append(node)
                on_stack.add(node)
                edges = iter(graph[node])
            for edge in edges:
                if edge.to not in number:
                    work += (node, edges), (edge.to, iter(()))
                    break
                if edge.to in on_stack:
                    low[node] = min(low[node], low[edge.to])
            else:
                if low[node] == number[node]:
                    found.append(part := set(stack[stack.index(node) :]))
                    del stack[-len(part) :]
                    on_stack -= part
                if work:
                    above = work[-1][0]
                    low[above] = min(low[above], low[node])
    return found


def _cycle_from(inside: Graph, start: _Node, states: list[SearchState]) -> list[Way]:
    """Return a fair cycle of ways from *start*: a short one, though not always the shortest."""
    ways: list[Way] = []
    here, left_out = start, _possible(states[start.state])
    while left_out:
        for edge in _path(
            inside,
            here,
            lambda edge, out=left_out: bool(  # type: ignore[misc]
                out - _possible(states[edge.to.state]) or _fair_key(edge.way.action) in out
            ),
        ):
            ways.append(edge.way)
            here = edge.to
            left_out = (left_out & _possible(states[here.state])) - {_fair_key(edge.way.action)}
    if here != start:
        ways += [edge.way for edge in _path(inside, here, lambda edge: edge.to == start)]
    return ways


def _path(inside: Graph, start: _Node, is_wanted: Callable[[_Edge], bool]) -> list[_Edge]:
    """Return the shortest path from *start* to an edge for which *is_wanted* is true."""
    reached_by: dict[_Node, tuple[_Node, _Edge]] = {}
    nodes = deque([start])
    while True:
        node = nodes.popleft()
        for edge in inside[node]:
            if is_wanted(edge):
                path = [edge]
                while node != start:
                    node, before = reached_by[node]
                    path.append(before)
                return path[::-1]
            if edge.to not in reached_by:
                reached_by[edge.to] = node, edge
                nodes.append(edge.to)
