"""A life cycle as a diagram in the language of Graphviz, like figures 2 and 10 of Lütkebohle et al.

The active states are in a frame. A transition that all active states have is drawn once, from the
frame. If it leads each of these states back to itself, it is written in the frame instead.
"""

from collections.abc import Iterator

import msgspec

from tca_tools.drawing.chart_dot import INK, graph, quoted
from tca_tools.life_cycle.table import TAKEN_BY
from tca_wire.life_cycles import LifeCycle, Transition
from tca_wire.vocabulary import Party

COLOURS = {Party.CLIENT: "#0b4f8a", Party.SERVER: "#1f2933", Party.BOTH: "#7b3fa0"}
"""The colour of an arrow and its text, by the party of the transition."""
_FILLS = {"first": "#fff3c4", "active": "#ffe4b0", "done": "#cfeccb", "cancelled": "#d5d5d5"}


def dot_source(life_cycle: LifeCycle) -> str:
    """Return a directed graph of the states."""
    title = quoted(*_title(life_cycle))
    return graph([f"graph [rankdir=LR, ranksep=0.7, label={title}];", *_statements(life_cycle)])


def _title(life_cycle: LifeCycle) -> list[str]:
    present = {one.by for one in life_cycle.transitions}
    parties = [party for party in TAKEN_BY if party in present]
    words = {Party.CLIENT: "dashed, blue", Party.SERVER: "black", Party.BOTH: "violet"}
    return [
        f"life cycle '{life_cycle.name}'",
        *(f"{words[party]}: by {TAKEN_BY[party]}" for party in parties),
    ]


def _statements(life_cycle: LifeCycle) -> Iterator[str]:
    ids = {state: f"s{number}" for number, state in enumerate(life_cycle.states)}
    common = _common(life_cycle)
    yield f'start [shape=point, width=0.12, fillcolor="{INK}"]; start -> {ids[life_cycle.initial]};'
    yield _node(ids, life_cycle.initial, _FILLS["first"])
    within = [one for one in common if one.source == one.target]
    words = quoted("active", *(f"{one.name} ({TAKEN_BY[one.by]})" for one in within))
    inner = " ".join(_node(ids, state, _FILLS["active"]) for state in life_cycle.active)
    yield f'subgraph cluster_active {{ label={words}; style="rounded"; color="#52606d"; {inner} }}'
    for ends, kind in ((life_cycle.successes, "done"), (life_cycle.failures, "cancelled")):
        for state in ends:
            yield _node(ids, state, _FILLS[kind], ", peripheries=2")
    drawn_once = set(map(_without_source, common))
    drawn = [one for one in life_cycle.transitions if _without_source(one) not in drawn_once]
    leaving = [one for one in common if one not in within]
    for rows, looks in ((drawn, ""), (leaving, ", ltail=cluster_active")):
        for (source, target, by), names in _joined(rows).items():
            yield f"{ids[source]} -> {ids[target]} [{_arrow(names, by)}{looks}];"


def _common(life_cycle: LifeCycle) -> list[Transition]:
    """Return the transitions that all active states have, as rows of the first active state."""
    active = life_cycle.active
    if len(active) < 2:
        return []
    of_each = [
        {_without_source(one) for one in life_cycle.transitions if one.source == state}
        for state in active
    ]
    of_all = set.intersection(*of_each)
    of_first = [one for one in life_cycle.transitions if one.source == active[0]]
    return [
        one for one in of_first if _without_source(one) in of_all and one.target not in active[1:]
    ]


def _without_source(one: Transition) -> Transition:
    """Return a key for equal transitions of several states, to one target or back to themselves."""
    target = "" if one.target == one.source else one.target
    return msgspec.structs.replace(one, source="", target=target)


def _joined(rows: list[Transition]) -> dict[tuple[str, str, Party], list[str]]:
    """Group the names of the transitions that share an arrow."""
    joined: dict[tuple[str, str, Party], list[str]] = {}
    for one in rows:
        joined.setdefault((one.source, one.target, one.by), []).append(one.name)
    return joined


def _node(ids: dict[str, str], state: str, fill: str, more: str = "") -> str:
    return f'{ids[state]} [label={quoted(state)}, fillcolor="{fill}"{more}];'


def _arrow(names: list[str], by: Party) -> str:
    style = ', style="dashed"' if by is Party.CLIENT else ""
    words = quoted(*names)
    return (
        f'label={words}, color="{COLOURS[by]}", fontcolor="{COLOURS[by]}", tooltip={words}{style}'
    )
