"""Goes through every run of a scenario, breadth first: what it finds wrong is shown by the shortest run that does."""

from collections import Counter, deque
from collections.abc import Iterable

import msgspec

from tca_central.invariants import check_invariants
from tca_explorer.errors import CentralFault, ScenarioError
from tca_explorer.fingerprint import fingerprint
from tca_explorer.play import Action, Play
from tca_explorer.properties import Property
from tca_explorer.scenario import Scenario
from tca_explorer.words import unfinished
from tca_explorer.world import World

LIMIT = 100_000
"""States after which an exploration ends without an answer, unless said otherwise."""

KEPT_PLAYS = 1000
"""States on the way whose play is kept; that of the others is played again from the start when it is needed."""


class Violation(msgspec.Struct, frozen=True):
    """Something that must be true and is not, after these actions."""

    broken: str
    """What must be true."""
    why: str
    """What is wrong in the last state."""
    actions: tuple[Action, ...]


class Result(msgspec.Struct, frozen=True):
    """What an exploration found."""

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

    @property
    def ok(self) -> bool:
        """Whether everything is true in all runs, and all runs were explored."""
        return self.is_complete and self.violation is None


class _State:
    """A state that was reached, by the action that first led to it."""

    __slots__ = ("action", "before", "following", "memories", "play")

    def __init__(self, before: "_State | None", action: Action | None, memories: tuple[int, ...]) -> None:
        self.before = before
        self.action = action
        self.memories = memories  #: of the properties
        self.following: list[_State] = []
        self.play: Play | None = None  #: None: must be played again

    def actions(self) -> tuple[Action, ...]:
        """The shortest way here."""
        actions: list[Action] = []
        state = self
        while state.before is not None and state.action is not None:
            actions.append(state.action)
            state = state.before
        return tuple(reversed(actions))


def explore(scenario: Scenario, *properties: Property, limit: int = LIMIT) -> Result:
    """Explore every run of *scenario*, until something is found that must not be, or *limit* states were seen.

    Checks the properties of the scenario, these further *properties*, and central's own invariants. Raises
    ScenarioError if a script can't be played.
    """
    return _Exploration(scenario, (*scenario.properties, *properties), limit).run()


class _Exploration:
    def __init__(self, scenario: Scenario, properties: Iterable[Property], limit: int) -> None:
        self.scenario = scenario
        self.properties = tuple(properties)
        self.limit = limit
        self.known: dict[bytes, _State] = {}
        self.frontier: deque[_State] = deque()
        self.steps = 0
        self.ends = 0
        self.kept = 0

    def run(self) -> Result:
        """All states, nearest first."""
        violation = self._arrive(None, None, Play(self.scenario))
        while self.frontier and violation is None and len(self.known) <= self.limit:
            violation = self._leave(self.frontier.popleft())
        is_complete = not self.frontier and violation is None
        longest = _longest_way(list(self.known.values())) if is_complete else None
        return Result(self.scenario, len(self.known), self.steps, self.ends, longest, is_complete, violation)

    def _leave(self, state: _State) -> Violation | None:
        """Take every action that is possible in a state."""
        play = self._play_of(state)
        actions = play.actions()
        if all(action.is_optional for action in actions):
            self.ends += 1
            if violation := self._end(state, play):
                return violation
        for action in actions:
            violation = self._take(state, action, play if action is actions[-1] else _replay(self.scenario, state))
            if violation is not None:
                return violation
        return None

    def _play_of(self, state: _State) -> Play:
        play, state.play = state.play, None
        if play is None:
            return _replay(self.scenario, state)
        self.kept -= 1
        return play

    def _take(self, state: _State, action: Action, play: Play) -> Violation | None:
        self.steps += 1
        try:
            play.perform(action)
        except CentralFault as fault:
            return Violation("central handles everything", str(fault), (*state.actions(), action))
        return self._arrive(state, action, play)

    def _arrive(self, before: _State | None, action: Action | None, play: Play) -> Violation | None:
        """A state is reached: check it, and remember it if it is new."""
        memories = before.memories if before else (0,) * len(self.properties)
        state = _State(before, action, memories)
        if play.world.broken:
            return Violation("what central promises", play.world.broken, state.actions())
        seen = [_judged(one, play.world, memory) for one, memory in zip(self.properties, memories, strict=True)]
        for one, (_, why) in zip(self.properties, seen, strict=True):
            if why:
                return Violation(str(one), why, state.actions())
        state.memories = tuple(memory for memory, _ in seen)
        key = fingerprint(play, state.memories)
        known = self.known.get(key)
        if before is not None:
            before.following.append(known or state)
        if known is not None:
            return None
        try:
            check_invariants(play.central)
        except AssertionError as error:
            return Violation("central's own invariants", str(error), state.actions())
        self.known[key] = state
        self.frontier.append(state)
        if self.kept < KEPT_PLAYS:
            self.kept += 1
            state.play = play
        return None

    def _end(self, state: _State, play: Play) -> Violation | None:
        """A run may end here."""
        play.world.unfinished = unfinished(play)
        for one, memory in zip(self.properties, state.memories, strict=True):
            if why := one.ended(play.world, memory):
                return Violation(str(one), why, state.actions())
        return None


def _replay(scenario: Scenario, state: _State) -> Play:
    """Play the run to a state again. Of 13 actions this takes a third of the time of a deep copy, of 50 as long."""
    play = Play(scenario)
    for action in state.actions():
        play.perform(action)
    return play


def _longest_way(states: list[_State]) -> int | None:
    """The most actions from the first state to any; None if there is a way round in a circle."""
    ways_in = Counter(id(following) for state in states for following in state.following)
    length = dict.fromkeys(map(id, states), 0)
    ready = states[:1]
    for state in ready:  # grows while it is walked
        for following in state.following:
            length[id(following)] = max(length[id(following)], length[id(state)] + 1)
            ways_in[id(following)] -= 1
            if not ways_in[id(following)]:
                ready.append(following)
    return max(length.values()) if len(ready) == len(states) else None


def _judged(one: Property, world: World, memory: int) -> tuple[int, str]:
    """What a property says; a predicate that can't be asked is a mistake in the scenario, not in the robot."""
    try:
        return one.seen(world, memory)
    except Exception as error:
        raise ScenarioError(f"property '{one}' can't be asked: {type(error).__name__}: {error}") from error
