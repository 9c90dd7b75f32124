"""Explore every run of a scenario, breadth first, so that a counterexample is a shortest one."""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from tca_central.core import Central
from tca_central.loading import is_compiled
from tca_module import checks
from tca_tools.explore.errors import CentralFault, ExplorerError, ScenarioError
from tca_tools.explore.observed.world import World, describe_breach
from tca_tools.explore.play.play import Action, Play, Waiter, outcome, still_waiting, waiters
from tca_tools.explore.play.words import unfinished
from tca_tools.explore.scenario.argument_checks import check as check_argument
from tca_tools.explore.scenario.scenario import Scenario, checked_properties
from tca_tools.explore.scenario.worker_thread import check_not_abandoned, in_worker_thread
from tca_tools.explore.search import cycles
from tca_tools.explore.search.branching import Branching
from tca_tools.explore.search.fingerprint import Detail, fingerprint_of
from tca_tools.explore.search.snapshot import Snapshots
from tca_tools.explore.search.states import Result, SearchState, Violation, Way, replayed
from tca_tools.properties.algebra import NeverStuck, Property, words_of
from tca_wire.text.nearest import nearest_or_all

LIMIT = 100_000
"""The default number of states after which an exploration ends without an answer."""

SNAPSHOT_BYTES = 256 << 20
"""The most bytes for snapshots of unexpanded states. A state without a snapshot is replayed."""

MAX_PLAYS = 500
"""The number of unexpanded states whose play itself is retained.

A play is ten times as big as a snapshot, but the search continues from it without a copy.
"""

STATES_PER_WATCH = 32
"""The number of states that are expanded between two calls of *watch*."""

Watch = Callable[[int, int], None] | None
Check = Callable[[Central], None] | None


def explore(
    scenario: Scenario,
    *properties: Property,
    limit: int = LIMIT,
    watch: Watch = None,
    check: Check = None,
) -> Result:
    """Explore every run of *scenario*, until a violation is found or *limit* states are reached.

    Args:
        scenario: the scenario, which has properties of its own.
        properties: further properties to check.
        limit: the most states to explore; 100,000 by default.
        watch: a function that is called now and then with two numbers: the states reached, and
            those that are not expanded yet.
        check: for tests of central itself: a function that is called with central in each new
            state and raises AssertionError if something is wrong.

    Returns:
        The result: a violation with the shortest run to it, or the size of the search.

    Raises:
        ScenarioError: a script can't be played, or a property can't be evaluated.
        ExplorerError: Central's core is compiled; the explorer needs the one in Python.

    Example::

        scenario = Scenario("fetching", never_stuck())
        ...  # its modules
        assert explore(scenario).ok
    """
    if is_compiled():
        raise ExplorerError(
            "the explorer needs central's core in Python, but the core here is machine code: "
            "install the Python core in a folder of its own "
            "(docs/decisions/0113-an-installation-has-one-core.md)"
        )
    if not isinstance(scenario, Scenario):
        raise ScenarioError(f"explore() needs a Scenario, not {scenario!r:.60}")
    check_argument("explore()", checks.COUNT, limit=limit)
    judged = (*scenario.properties, *checked_properties(properties))
    _check_module_names(scenario, judged)
    detail = Detail()
    while True:
        exploration = _Exploration(scenario, judged, limit, detail, watch, check)
        try:
            return in_worker_thread(exploration.run)
        except _DetailNeeded as more:
            detail = more.detail


class _DetailNeeded(BaseException):
    """Ends an exploration that must distinguish states by more; a new one starts."""

    def __init__(self, detail: Detail) -> None:
        super().__init__(detail)
        self.detail = detail


@dataclass(eq=False)
class _Exploration:
    scenario: Scenario
    properties: tuple[Property, ...]
    limit: int
    detail: Detail
    watch: Watch
    check: Check

    def __post_init__(self) -> None:
        self.known: dict[bytes, SearchState] = {}
        self.frontier: deque[SearchState] = deque()
        self.steps = 0
        self.ends = 0
        self.branching = Branching()
        self.outcomes: dict[bytes, SearchState] = {}
        self.plays: dict[SearchState, Play] = {}  #: of some states that are not expanded yet
        self.saved = 0  #: the bytes of all snapshots
        self.snapshots = Snapshots()
        #: The names of the messages that a module handles, or that a script has used so far.
        self.used_messages = set(self.scenario.messages())
        #: The places of the properties whose case has not arisen yet.
        self.without_case = set(range(len(self.properties)))

    def run(self) -> Result:
        """Explore all states, nearest first. If there are cycles of states, judge these."""
        violation = self._reach(None, None, Play(self.scenario))
        while self.frontier and violation is None and len(self.known) <= self.limit:
            violation = self._expand(self.frontier.popleft())
            expanded = len(self.known) - len(self.frontier)
            if self.watch is not None and not expanded % STATES_PER_WATCH:
                self.watch(len(self.known), len(self.frontier))
        is_complete = not self.frontier and violation is None
        states = list(self.known.values())
        longest = _longest_run(states) if is_complete else None
        if is_complete and longest is None:
            violation = self._judge_cycles(states)
        if is_complete:
            _check_message_names(self.scenario, self.properties, self.used_messages)
        vacuous = (self.properties[number] for number in sorted(self.without_case) if is_complete)
        return Result(
            self.scenario,
            len(self.known),
            self.steps,
            self.ends,
            longest,
            is_complete,
            violation,
            tuple(f"'{prop}': '{words_of(prop.case)}' is never true" for prop in vacuous),
            {key: state.actions() for key, state in self.outcomes.items()},
            self.branching.most(),
        )

    def _judge_cycles(self, states: list[SearchState]) -> Violation | None:
        """Return the violation of a property by a run that never ends; None if there is none."""
        if not any(isinstance(prop, NeverStuck) or prop.may_be_owed for prop in self.properties):
            return None
        # A waiter can be followed from state to state only if ``names`` are part of the states.
        if not self.detail.names:
            raise _DetailNeeded(msgspec.structs.replace(self.detail, names=True))
        return cycles.judge(self.scenario, self.properties, states)

    def _expand(self, state: SearchState) -> Violation | None:
        """Perform every action that is possible in a state."""
        check_not_abandoned()
        play = self.plays.pop(state, None) or self._play_of(state)
        actions = play.actions()
        self.branching.add(play, actions)
        if all(action.is_optional for action in actions):
            self.ends += 1
            if self.scenario.has_prefetch:
                self.outcomes.setdefault(outcome(play), state)
            if violation := self._judge_end(state, play):
                return violation
        if len(actions) > 1:
            self._save(state, play)
        for action in actions:
            at_state = play if action is actions[-1] else self._play_of(state)
            if violation := self._perform(state, action, at_state):
                return violation
        if state.snapshot is not None:
            self.saved -= len(state.snapshot)
            state.snapshot = None
        return None

    def _play_of(self, state: SearchState) -> Play:
        if state.snapshot is None:
            return replayed(self.scenario, state)
        return self.snapshots.load(state.snapshot)

    def _perform(self, state: SearchState, action: Action, play: Play) -> Violation | None:
        """Perform an action in *play*, which is in *state*."""
        self.steps += 1
        waited = waiters(play) if self.detail.names else []
        try:
            play.perform(action)
        except CentralFault as fault:
            return Violation("central handles everything", str(fault), (*state.actions(), action))
        return self._reach(state, action, play, waited)

    def _reach(
        self,
        before: SearchState | None,
        action: Action | None,
        play: Play,
        waited: Sequence[Waiter] = (),
    ) -> Violation | None:
        """Check a state that was reached, and store it if it is new."""
        memories = before.memories if before else (0,) * len(self.properties)
        state = SearchState(before, action, memories)
        if play.broken:
            return Violation("what central promises", play.broken, state.actions())
        if violation := self._judge(state, play, before.order if before else ()):
            return violation
        key, state.order = fingerprint_of(play, state.memories, self.detail)
        known = self.known.get(key)
        if before is not None and action is not None:
            still = still_waiting(waited, play) if self.detail.names else ()
            before.ways.append(Way(action, known or state, still))
        if known is not None:
            return None
        if self.check is not None:
            try:
                self.check(play.central)
            except AssertionError as error:
                return Violation("central's own invariants", str(error), state.actions())
        self.used_messages.update(play.central.registry.messages)
        self.known[key] = state
        self.frontier.append(state)
        if len(self.plays) < MAX_PLAYS:
            self.plays[state] = play
        else:
            self._save(state, play)
        return None

    def _save(self, state: SearchState, play: Play) -> None:
        """Store a snapshot of a state, if there is room and it has none."""
        if state.snapshot is None and self.saved < SNAPSHOT_BYTES:
            state.snapshot = self.snapshots.save(play)
            self.saved += len(state.snapshot)

    def _judge(self, state: SearchState, play: Play, order: tuple[int, ...]) -> Violation | None:
        """Store the memories of the properties in *state*; return the first violation."""
        places = {message: place for place, message in enumerate(order)}
        world = World(play.world, places, play.taken, self._require_time)
        memories = []
        for number, (prop, memory) in enumerate(zip(self.properties, state.memories, strict=True)):
            try:
                remembered, breach = prop.seen(world, memory)
                if number in self.without_case and (
                    prop.case is None or world.true_of(prop.case).is_true
                ):
                    self.without_case.discard(number)
            except Exception as error:
                raise ScenarioError(
                    f"property '{prop}' can't be asked: {type(error).__name__}: {error}"
                ) from error
            if breach:
                return Violation(str(prop), describe_breach(breach), state.actions())
            memories.append(remembered)
        state.memories = tuple(memories)
        return None

    def _require_time(self) -> None:
        """Start again with the time as part of the state, since a property reads the time."""
        if not self.detail.time:
            raise _DetailNeeded(msgspec.structs.replace(self.detail, time=True))

    def _judge_end(self, state: SearchState, play: Play) -> Violation | None:
        """Return the violation of a run that ends in this state."""
        left = "".join(f"\n{line}" for line in unfinished(play))
        for prop, memory in zip(self.properties, state.memories, strict=True):
            breach = ""
            if isinstance(prop, NeverStuck) and left:
                breach = f"with this left:{left}"
            elif prop.is_owed(memory):
                left += "".join(f"\n{words}" for words in _unknown_names(prop, self.used_messages))
                breach = f"and it never happened{left}"
            if breach:
                return Violation(str(prop), f"the run may end here, {breach}", state.actions())
        return None


def _longest_run(states: list[SearchState]) -> int | None:
    """Return the number of actions of the longest run; None if there is a cycle."""
    ways_in = Counter(id(way.to) for state in states for way in state.ways)
    length = dict.fromkeys(map(id, states), 0)
    ready = states[:1]
    for state in ready:  # the list grows during the loop
        for way in state.ways:
            length[id(way.to)] = max(length[id(way.to)], length[id(state)] + 1)
            ways_in[id(way.to)] -= 1
            if not ways_in[id(way.to)]:
                ready.append(way.to)
    return max(length.values()) if len(ready) == len(states) else None


# --- names: a property with a misspelt name would hold, and the mistake would go unnoticed --------


def _check_module_names(scenario: Scenario, properties: Iterable[Property]) -> None:
    """Raise ScenarioError if a property names a module that the scenario does not have."""
    for prop in properties:
        for named in prop.named:
            if named.module and named.module.partition("#")[0] not in scenario.modules:
                raise ScenarioError(
                    f"property '{prop}': scenario '{scenario.title}' has no module "
                    f"'{named.module}'; {nearest_or_all(named.module, scenario.modules)}"
                )


def _check_message_names(
    scenario: Scenario, properties: Iterable[Property], used_messages: Collection[str]
) -> None:
    """Raise ScenarioError if the name of a message is not among *used_messages*."""
    calls = [("may_kill()", scenario.may_be_killed), ("may_suspend()", scenario.may_be_suspended)]
    missing = [
        f"property '{prop}': {words}"
        for prop in properties
        for words in _unknown_names(prop, used_messages)
    ]
    missing += [
        f"{call}: {_missing(name, used_messages)}"
        for call, names in calls
        for name in names
        if name not in used_messages
    ]
    if missing:
        raise ScenarioError(f"it can't be judged: {missing[0]}")


def _unknown_names(prop: Property, used_messages: Collection[str]) -> Iterator[str]:
    """Return an error for each unknown message name in a property."""
    names = dict.fromkeys(named.message for named in prop.named if named.message)
    return (_missing(name, used_messages) for name in names if name not in used_messages)


def _missing(name: str, used_messages: Collection[str]) -> str:
    return (
        f"there is no message '{name}': no module handles it, and no script uses it; "
        f"{nearest_or_all(name, used_messages)}"
    )
