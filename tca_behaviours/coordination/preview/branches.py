"""The facts that a branch of a machine may need unchanged.

Early work may change such a fact only if the work can be undone. The facts follow from the
structure of a machine alone: they are its live variables, as in a compiler.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.machine import Coordination
from tca_behaviours.coordination.model.states import FAILED
from tca_behaviours.statecharts.soundness import arrows_of


class BareArrow(NamedTuple):
    """An arrow from one leaf to another, without likelihood or guard."""

    target: int
    is_failure: bool = False
    """Whether the arrow is taken when an activity fails, or can't begin."""


def needed_later(machine: Coordination) -> dict[int, dict[str, int]]:
    """For each leaf, return the facts that a branch after the leaf may need unchanged.

    The value for each fact is the leaf where that branch starts. An arrow whose likelihood is the
    constant 0 starts no branch.
    """
    leaves = [state for state in machine.states if state.leaf is state]
    arrows = {}
    for leaf in leaves:
        written = arrows_of(leaf)
        # If no arrow is possible, keep all: a state without arrows would count as an end.
        possible = [arrow for arrow in written if not arrow.is_impossible] or written
        arrows[leaf.number] = [
            BareArrow(arrow.target.leaf.number, arrow.event == FAILED) for arrow in possible
        ]
    return live_facts(
        arrows, {leaf.number: leaf.activity for leaf in leaves if leaf.activity is not None}
    )


def live_facts(
    arrows: Mapping[int, Sequence[BareArrow]], activities: Mapping[int, Activity]
) -> dict[int, dict[str, int]]:
    """For each state, return the facts that some path after the state needs unchanged.

    That is, an activity on the path needs the fact before any activity on the path changes it. The
    value for each fact is the first state of that path. A state without arrows is an end. It needs
    all facts that any activity changes, because the next run builds on their values.
    """
    changed = set().union(*(activity.makes for activity in activities.values()))
    needed_at: dict[int, set[str]] = {
        state: set() if ways_out else changed for state, ways_out in arrows.items()
    }
    is_stable = False
    while not is_stable:
        is_stable = True
        # Needs spread against the arrows. To begin with the last states takes the fewest rounds.
        for state in reversed([state for state in arrows if arrows[state]]):
            live = _live_before(arrows[state], needed_at, activities.get(state))
            if live != needed_at[state]:
                needed_at[state] = live
                is_stable = False
    return {
        state: {
            fact: arrow.target
            for arrow in reversed(arrows[state])
            for fact in needed_at[arrow.target]
        }
        for state in arrows
    }


def _live_before(
    arrows: Sequence[BareArrow], needed_at: Mapping[int, set[str]], activity: Activity | None
) -> set[str]:
    """Return the facts that must be unchanged when a state is entered, for itself or a later
    state.
    """
    later = set().union(*(needed_at[arrow.target] for arrow in arrows))
    if activity is None:
        return later
    live = activity.needs.keys() | (later - activity.makes.keys())
    if activity.needs:  # an activity whose needs do not hold fails and changes nothing
        live |= set().union(*(needed_at[arrow.target] for arrow in arrows if arrow.is_failure))
    return live


def first_harmed_fact(activity: Activity, needed: Mapping[str, int]) -> str | None:
    """Return the first fact that an activity changes and a branch needs unchanged, if any."""
    return next((fact for fact in activity.makes if fact in needed), None)
