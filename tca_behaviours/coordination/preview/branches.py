"""The variables that a branch of a machine may need unchanged.

Early work may change one only if it can be undone. They are the live variables that compilers
compute, and follow from the structure of a machine alone.
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
    """Whether it is taken when an activity fails, or can't begin."""


def needed_later(machine: Coordination) -> dict[int, dict[str, int]]:
    """For each leaf, the variables that a branch after it may need unchanged.

    Each variable has the leaf where that branch starts. An arrow whose likelihood is the constant 0
    starts no branch.
    """
    leaves = [state for state in machine.states if state.leaf is state]
    arrows = {
        leaf.number: [
            BareArrow(arrow.target.leaf.number, arrow.event == FAILED)
            for arrow in [arrow for arrow in arrows_of(leaf) if not arrow.is_impossible]
            or arrows_of(leaf)
        ]
        for leaf in leaves
    }
    return live_variables(
        arrows, {leaf.number: leaf.activity for leaf in leaves if leaf.activity is not None}
    )


def live_variables(
    arrows: Mapping[int, Sequence[BareArrow]], activities: Mapping[int, Activity]
) -> dict[int, dict[str, int]]:
    """For each state, the variables that some path after it needs before it changes them.

    Each variable has the first state of that path. A state without arrows is an end, and needs all
    variables: the next run builds on the values that this run leaves.
    """
    changed = set().union(*(activity.makes for activity in activities.values()))
    entering: dict[int, set[str]] = {
        state: set() if following else changed for state, following in arrows.items()
    }
    is_stable = False
    while not is_stable:
        is_stable = True
        # Needs travel against the arrows, so the last states first take the fewest rounds.
        for state in reversed([state for state in arrows if arrows[state]]):
            live = _live_before(arrows[state], entering, activities.get(state))
            if live != entering[state]:
                entering[state] = live
                is_stable = False
    return {
        state: {
            variable: arrow.target
            for arrow in reversed(arrows[state])
            for variable in entering[arrow.target]
        }
        for state in arrows
    }


def _live_before(
    arrows: Sequence[BareArrow], entering: Mapping[int, set[str]], activity: Activity | None
) -> set[str]:
    """The variables that a state, or a state after it, needs unchanged when it is entered."""
    later = set().union(*(entering[arrow.target] for arrow in arrows))
    if activity is None:
        return later
    live = activity.needs.keys() | (later - activity.makes.keys())
    if activity.needs:  # if they do not hold, the activity fails without having changed anything
        live |= set().union(*(entering[arrow.target] for arrow in arrows if arrow.is_failure))
    return live


def harmed(activity: Activity, needed: Mapping[str, int]) -> str | None:
    """The first variable that an activity changes and a branch needs unchanged, if any."""
    return next((variable for variable in activity.makes if variable in needed), None)
