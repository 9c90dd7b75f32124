"""The checks of a machine before it may run.

The search goes from the inside out: the exits of a container follow from those of the states in it.
"""

from collections.abc import Collection, Mapping

from tca_behaviours.missions.charts.policies import Policy
from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.statecharts.soundness import (
    all_reached,
    check_no_cycle,
    named,
    refuse_unreached,
)
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_module.checks import quoted
from tca_wire.charts import StateKind

Exits = dict[str | MachineState, bool]
"""The exits of a state: endings, or states that follow. The value is True if the state may be left
that way before any task has run.
"""


def endings_of(root: MachineState) -> dict[MachineState, list[str]]:
    """Return the endings that each state can have. Raises UnsoundMachine if the machine can't be
    run.
    """
    _check_outcomes(root)
    search = _Search()
    search.exits(root)
    return search.endings


class _Search:
    def __init__(self) -> None:
        self.endings: dict[MachineState, list[str]] = {}

    def exits(self, state: MachineState) -> Exits:
        """Return the exits of a state. An ending that leads to a state is replaced by that
        state.
        """
        _check_targets(state)
        inner = self._inner_exits(state)
        own = sorted({exit_ for exit_ in inner if isinstance(exit_, str)} - set(ENDINGS))
        self.endings[state] = [*(ending for ending in ENDINGS if ending in inner), *own]
        timed = state.timed
        if way := next((one for one in state.outcomes if one not in inner), None):
            raise UnsoundMachine(f"{state!r} never ends as {way}: lead a state to it, or remove it")
        for ending in state.by_event:
            if ending not in self.endings[state] and (timed is None or ending != timed.event):
                possible = " or ".join(self.endings[state])
                only = f", only as {possible}" if possible else ""
                raise UnsoundMachine(
                    f"{state!r} can't end as {ending}{only}: rename or remove on({ending}=...)"
                )
        found: Exits = {}
        for exit_, is_at_once in inner.items():
            to = exit_ if isinstance(exit_, MachineState) else state.follower(exit_)
            found[to] = found.get(to, False) or is_at_once
        if timed is not None:
            if state.kind in (StateKind.EPSILON, StateKind.CALL):
                raise UnsoundMachine(f"{state!r} does not wait for a time: remove {timed.call}")
            found.setdefault(timed.end, False)
        if state.parent is not None and not state.parent.kind.is_concurrent:
            _check_own(state, found, state.parent)
        return found

    def _inner_exits(self, state: MachineState) -> Exits:
        """Return the exits of a state by the endings of its task, or by the exits of the states in
        it.
        """
        if state.kind is StateKind.TASK:
            return dict.fromkeys(ENDINGS, False)
        if state.kind is StateKind.CALL:
            return dict.fromkeys((*state.outcomes, "failed"), False)
        if state.kind is StateKind.EPSILON:
            return {"completed": True}
        if state.kind.is_concurrent:
            return self._exits_of_concurrence(state)
        return self._exits_of_successive(state)

    def _exits_of_concurrence(self, state: MachineState) -> Exits:
        _check_branches(state)
        exits_of = {branch: self.exits(branch) for branch in state.children}
        for branch, exits in exits_of.items():
            if any(exits.values()):
                raise UnsoundMachine(
                    f"{branch!r} may end before any task in it has run, and would end {state!r}"
                )
        endings = {
            branch.label: [exit_ for exit_ in exits if isinstance(exit_, str)]
            for branch, exits in exits_of.items()
        }
        found: Exits = {
            exit_: False
            for branch, exits in exits_of.items()
            for exit_ in exits
            if isinstance(exit_, MachineState) and exit_ is not branch
        }
        found |= dict.fromkeys(_endings_of_concurrence(state, endings), False)
        _check_own(state, found, state)
        return found

    def _exits_of_successive(self, state: MachineState) -> Exits:
        """Return the exits of a container whose states run one after the other."""
        exits_of = {child: self.exits(child) for child in state.children}
        successors = {
            child: [to for to in exits if to in exits_of] for child, exits in exits_of.items()
        }
        reached = all_reached(state.children[0], successors.__getitem__)
        refuse_unreached([child for child in exits_of if child not in reached])
        at_once = {
            child: [to for to in successors[child] if exits[to]]
            for child, exits in exits_of.items()
        }
        check_no_cycle(at_once)
        reached_at_once = all_reached(state.children[0], at_once.__getitem__)
        found: Exits = {}
        for child, exits in exits_of.items():
            for to, is_at_once in exits.items():
                if to not in exits_of:
                    found[to] = found.get(to, False) or (is_at_once and child in reached_at_once)
        return found


def _check_outcomes(root: MachineState) -> None:
    """Check that no outcome has the label of a state: a transition could mean either."""
    labels = {state.label for state in root.all() if state is not root}
    for state in root.all():
        if state.kind.is_container and (both := labels.intersection(state.outcomes)):
            raise UnsoundMachine(
                f"'{min(both)}' is an outcome of {state!r} and the label of a state: rename one"
            )


def _check_own(state: MachineState, exits: Exits, container: MachineState) -> None:
    """Check that each own outcome that is passed to a container is one of its outcomes."""
    for exit_ in exits:
        if isinstance(exit_, str) and exit_ not in (*ENDINGS, *container.outcomes):
            raise UnsoundMachine(
                f"{state!r} may end as {exit_}, and nothing follows: add on({exit_}=...), "
                f"or add it to the outcomes of {container!r}"
            )


def _check_branches(state: MachineState) -> None:
    """Check that a concurrence has several states, and at most one of them in the foreground of a
    server.
    """
    if len(state.children) == 1:
        raise UnsoundMachine(
            f"{state!r} has only one state: add another, or remove the concurrence"
        )
    by_server: dict[str, dict[MachineState, None]] = {}
    for branch in state.children:
        for one in filter(_is_foreground, branch.all()):
            by_server.setdefault(one.server, {})[branch] = None
    for foreground in by_server.values():
        if len(foreground) > 1:
            raise UnsoundMachine(
                f"{state!r}: {named(list(foreground))} would run in the foreground at the same "
                "time, and stop each other: give foreground=False to the tasks of all but one"
            )


def _endings_of_concurrence(
    state: MachineState, endings: Mapping[str, list[str]]
) -> Collection[str]:
    """Return the endings of a concurrence whose states have these *endings*, by label."""
    policy = state.policy
    assert policy is not None
    _check_rows(state, policy, endings)
    usual = dict.fromkeys(ending for some in endings.values() for ending in some)
    if policy.until is None and state.kind is not StateKind.ANY:
        if not all("completed" in some for some in endings.values()):
            usual.pop("completed", None)
        if state.kind is StateKind.ALL_ENDED and not all(endings.values()):
            usual.clear()
    if not usual:
        return ()
    return dict.fromkeys([*policy.outcome_map, *([policy.default] if policy.default else usual)])


def _check_rows(state: MachineState, policy: Policy, endings: Mapping[str, list[str]]) -> None:
    """Check that the outcome map names states of the concurrence, and endings that they can have.

    A state that is stopped when the concurrence ends is interrupted.
    """
    for outcome, row in policy.outcome_map.items():
        for label, ending in row.items():
            if label not in endings:
                raise UnsoundMachine(
                    f"{state!r}: the outcome map names '{label}' for {outcome}, "
                    f"which is not a state in it: name one of {quoted(endings)}"
                )
            if ending not in (possible := dict.fromkeys([*endings[label], "interrupted"])):
                raise UnsoundMachine(
                    f"{state!r}: the outcome map has '{label}' as {ending} for {outcome}, "
                    f"which can end only as {' or '.join(possible)}: name one of these"
                )


def _check_targets(state: MachineState) -> None:
    """Check that no transition leads into a container from outside it, nor to a state that runs at
    the same time.
    """
    containers = list(state.containers())
    for arrow in state.arrows:
        if arrow.outcome:
            continue
        target = arrow.target
        if target is state or target in containers:
            continue  # the target is entered again
        assert target.parent is not None, "the whole machine has no label"
        if target.parent not in containers:
            msg = (
                f"{target!r} is inside {target.parent!r}: "
                f"lead to a state beside or around {state!r}"
            )
        elif target.parent.kind.is_concurrent:
            msg = f"{target!r} runs at the same time in {target.parent!r}: lead to another state"
        else:
            continue
        raise UnsoundMachine(f"{state!r}: {arrow.call}: {msg}")


def _is_foreground(state: MachineState) -> bool:
    return state.kind is StateKind.TASK and bool(state.parameters.get("foreground", True))
