"""The checks that every machine must pass before it may run."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any, TypeVar

from tca_behaviours.statecharts.states import A, State, UnsoundMachine
from tca_wire.charts import StateKind
from tca_wire.text.measures import listed

T = TypeVar("T")


def arrows_of(leaf: State[Any, A]) -> list[A]:
    """Return the arrows that may lead out of a leaf: its own, then those of the compounds around
    it.

    A final state inside a compound is left only by the end of the compound.
    """
    if leaf.kind is StateKind.FINAL:
        return [arrow for arrow in next(leaf.containers()).arrows if not arrow.is_inherited]
    found: list[A] = []
    for state in (leaf, *leaf.containers()):
        for arrow in state.arrows:
            if (state is leaf or arrow.is_inherited) and not any(map(arrow.is_hidden_by, found)):
                found.append(arrow)
    return found


def check_arrows(states: Sequence[State[Any, A]]) -> None:
    """Check that each state can be reached from the first one, and each arrow can be taken.

    Raises UnsoundMachine.
    """
    for state in states:
        for place, arrow in enumerate(state.arrows):
            if hidden_by := next(filter(arrow.is_hidden_by, state.arrows[:place]), None):
                raise UnsoundMachine(
                    f"{state!r}: its transition for '{arrow.symbol}' is never taken: one for"
                    f" '{hidden_by.symbol}' comes first; give each a guard of its own name,"
                    " and write the one without a guard last"
                )
    leaves = [state for state in states if not state.children]
    ways_out = {leaf: arrows_of(leaf) for leaf in leaves}
    reached = all_reached(
        states[0].leaf, lambda leaf: (arrow.target.leaf for arrow in ways_out[leaf])
    )
    entered = reached | {outer for leaf in reached for outer in leaf.containers()}
    refuse_unreached([state for state in states if state not in entered])
    takeable = {arrow for arrows in ways_out.values() for arrow in arrows}
    if dead := next(
        (arrow for state in states for arrow in state.arrows if arrow not in takeable), None
    ):
        raise UnsoundMachine(
            f"{dead.source!r}: its transition for '{dead.symbol}' is never taken: in each state"
            f" inside another one for '{dead.event}' comes first; remove it"
        )


def all_reached(first: T, successors: Callable[[T], Iterable[T]]) -> set[T]:
    """Return all items that can be reached from *first*. *first* is one of them."""
    reached, todo = {first}, [first]
    while todo:
        new = set(successors(todo.pop())) - reached
        reached |= new
        todo += new
    return reached


def refuse_unreached(unreached: Sequence[object]) -> None:
    """Raise UnsoundMachine unless the list is empty."""
    if unreached:
        them = "them" if len(unreached) > 1 else "it"
        raise UnsoundMachine(
            f"{named(unreached)} can't be reached: add a transition to {them}, or remove {them}"
        )


def check_no_cycle(successors: Mapping[T, Iterable[T]]) -> None:
    """Raise UnsoundMachine if states that do nothing lead to each other in a cycle."""
    try:
        TopologicalSorter(successors).prepare()
    except CycleError as error:
        raise UnsoundMachine(
            f"{named(dict.fromkeys(error.args[1]))} lead to each other for ever and do nothing: "
            "make one of them lead to a state that does something"
        ) from None


def named(states: Iterable[object]) -> str:
    """Return the states in a sentence: "'a', 'b' and 'c'"."""
    return listed(list(map(repr, states)))
