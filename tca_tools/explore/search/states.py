"""The findings of an exploration: states, the ways between them, and the result."""

from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from tca_tools.explore.play.play import Action, Play
from tca_tools.explore.scenario.scenario import Scenario


class Violation(msgspec.Struct, frozen=True):
    """A condition that must be true, and a run in which it is not."""

    broken: str
    """The condition."""
    why: str
    """The error in the last state."""
    actions: tuple[Action, ...]
    """The run, from its start."""
    cycle: tuple[Action, ...] = ()
    """The actions that follow *actions* and repeat forever; empty if the run is finite."""


class Result(msgspec.Struct, frozen=True):
    """The result of an exploration."""

    scenario: Scenario
    states: int
    steps: int
    """The number of ways from one state to another."""
    ends: int
    """The number of states in which a run may end."""
    longest: int | None
    """The actions of the longest run; None if a run may never end, or not all were explored."""
    is_complete: bool
    """Whether all runs were explored."""
    violation: Violation | None = None
    """The condition that a run violates; None if no run does."""
    vacuous: tuple[str, ...] = ()
    """Properties that hold only because their case never arises: "'a before b': 'b' is never true".
    """
    outcomes: dict[bytes, tuple[Action, ...]] = {}
    """By end of a run (see ``play.outcome``): the shortest run to it. Empty without a prefetch."""
    branching: tuple[str, ...] = ()
    """The commonest alternatives in states, with their part of the states: "steps of arm (61 %)".
    """

    @property
    def ok(self) -> bool:
        """Whether all runs were explored, and all properties hold in all of them."""
        return self.is_complete and self.violation is None


@dataclass(slots=True, eq=False)
class SearchState:
    """A state that was reached, by the action that first led to it."""

    before: "SearchState | None"
    action: Action | None
    memories: tuple[int, ...]  #: one of each property
    ways: "list[Way]" = field(default_factory=list)
    order: tuple[int, ...] = ()  #: the messages under way, in an order common to all equal states
    snapshot: bytes | None = None  #: its play, until it is expanded; None: replay the run

    def actions(self) -> tuple[Action, ...]:
        """Return the actions of the shortest run to this state."""
        actions: list[Action] = []
        state = self
        while state.before is not None and state.action is not None:
            actions.append(state.action)
            state = state.before
        return tuple(reversed(actions))


class Way(NamedTuple):
    """A transition from a state to one that follows it."""

    action: Action
    to: SearchState
    new_places: tuple[int, ...]
    """For each waiter before the action, its place among the waiters after it; -1: waits no more.

    Empty if the search does not look for cycles.
    """


def replayed(scenario: Scenario, state: SearchState) -> Play:
    """Return a play of the state, by replaying its run from the start."""
    play = Play(scenario)
    for action in state.actions():
        play.perform(action)
    return play
