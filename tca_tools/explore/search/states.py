"""The findings of an exploration: states, the ways between them, and in the end a result."""

from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from tca_tools.explore.play.play import Action, Play
from tca_tools.explore.scenario.scenario import Scenario


class Violation(msgspec.Struct, frozen=True):
    """Something that must be true and is not, after these actions."""

    broken: str
    """The condition that must be true."""
    why: str
    """The error in the last state."""
    actions: tuple[Action, ...]
    cycle: tuple[Action, ...] = ()
    """Actions that come after these again and again, for ever, where a run that never ends shows
    it.
    """


class Result(msgspec.Struct, frozen=True):
    """The result of an exploration."""

    scenario: Scenario
    states: int
    steps: int
    """Ways from one state to another."""
    ends: int
    """States in which nothing further need happen."""
    longest: int | None
    """Actions of the longest run; None if a run need not end, or not all were explored."""
    is_complete: bool
    """Whether all runs were explored."""
    violation: Violation | None = None
    vacuous: tuple[str, ...] = ()
    """Properties that hold because what they are about never was: "'a before b': there never is
    'b'".
    """
    outcomes: dict[bytes, tuple[Action, ...]] = {}
    """Where modules have a prefetch: what was done, got and left in runs that end, and the shortest
    such run.
    """
    branching: tuple[str, ...] = ()
    """The commonest alternatives in states, with the part of the states: "steps of arm (61 %)"."""

    @property
    def ok(self) -> bool:
        """Whether everything is true in all runs, and all runs were explored."""
        return self.is_complete and self.violation is None


@dataclass(slots=True, eq=False)
class SearchState:
    """A state that was reached, by the action that first led to it."""

    before: "SearchState | None"
    action: Action | None
    memories: tuple[int, ...]  #: of the properties
    ways: "list[Way]" = field(default_factory=list)
    order: tuple[int, ...] = ()  #: the messages under way, in the order of all equal states
    snapshot: bytes | None = None  #: of its play, until it has been left; None: play it again

    def actions(self) -> tuple[Action, ...]:
        """The shortest way here."""
        actions: list[Action] = []
        state = self
        while state.before is not None and state.action is not None:
            actions.append(state.action)
            state = state.before
        return tuple(reversed(actions))


class Way(NamedTuple):
    """From a state to one that follows it."""

    action: Action
    to: SearchState
    new_places: tuple[int, ...]
    """By place of what waits before: its place among what waits after, or -1 where it waits no
    longer for the same. Empty where no cycles are looked for.
    """


def replayed(scenario: Scenario, state: SearchState) -> Play:
    """Play the run to a state again: it takes as long as the run is."""
    play = Play(scenario)
    for action in state.actions():
        play.perform(action)
    return play
