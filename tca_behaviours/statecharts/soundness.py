"""What must be true of every machine before it may run."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any, TypeVar

from tca_behaviours.statecharts.states import A, State, UnsoundMachine
from tca_wire.charts import StateKind
from tca_wire.text.measures import listed

T = TypeVar("T")


def arrows_of(leaf: State[Any, A]) -> list[A]:
    """The arrows by which a leaf may be left: its own and those of the compounds around it, from
    the inside out. A final state inside a compound is left by the compound's end only.
    """
    if leaf.kind is StateKind.FINAL:
        return [arrow for arrow in next(leaf.around()).arrows if not arrow.is_inherited]
    found: list[A] = []
    for state in (leaf, *leaf.around()):
        for arrow in state.arrows:
            if (state is leaf or arrow.is_inherited) and not any(map(arrow.is_hidden_by, found)):
                found.append(arrow)
    return found


def check_arrows(states: Sequence[State[Any, A]]) -> None:
    """Each state can be reached from the first one, and each arrow can be taken. Raises
    UnsoundMachine.
    """
    for state in states:
        for place, arrow in enumerate(state.arrows):
            if hidden_by := next(filter(arrow.is_hidden_by, state.arrows[:place]), None):
                raise UnsoundMachine(
                    f"{state!r}: its transition for '{arrow.symbol}' is never taken, as one for '{hidden_by.symbol}'"
                    " comes before it: give each a guard of its own name, and write the one without a guard last"
                )
    leaves = [state for state in states if not state.children]
    taken = {leaf: arrows_of(leaf) for leaf in leaves}
    reached = all_reached(states[0].leaf, lambda leaf: (arrow.target.leaf for arrow in taken[leaf]))
    entered = reached | {around for leaf in reached for around in leaf.around()}
    check_all_reached([state for state in states if state not in entered])
    known = {arrow for arrows in taken.values() for arrow in arrows}
    if dead := next(
        (arrow for state in states for arrow in state.arrows if arrow not in known), None
    ):
        raise UnsoundMachine(
            f"{dead.source!r}: its transition for '{dead.symbol}' is never taken, as in each state inside another"
            f" one for '{dead.event}' comes before it: remove it"
        )


def all_reached(first: T, following: Callable[[T], Iterable[T]]) -> set[T]:
    """All that are reached from the first."""
    reached, todo = {first}, [first]
    while todo:
        new = set(following(todo.pop())) - reached
        reached |= new
        todo += new
    return reached


def check_all_reached(lost: Sequence[object]) -> None:
    """Raises UnsoundMachine if any states were not reached."""
    if lost:
        them = "them" if len(lost) > 1 else "it"
        msg = f"{named(lost)} can't be reached: let a transition of a state that can lead there"
        raise UnsoundMachine(f"{msg}, or remove {them}")


def check_no_circle(after: Mapping[T, Iterable[T]]) -> None:
    """Raises UnsoundMachine if states in which nothing is done lead to each other for ever."""
    try:
        TopologicalSorter(after).prepare()
    except CycleError as error:
        msg = f"{named(dict.fromkeys(error.args[1]))} lead to each other for ever, and nothing is done"
        raise UnsoundMachine(
            f"{msg}: let one of them lead to a state in which something is done"
        ) from None


def named(states: Iterable[object]) -> str:
    """States in a sentence."""
    return listed(list(map(repr, states)))
