"""The checks of a machine before it may run.

The search goes from the inside out: the exits of a container follow from those of the states in it.
"""

from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.statecharts.soundness import (
    all_reached,
    check_no_cycle,
    named,
    refuse_unreached,
)
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_wire.charts import Ending, StateKind

Exits = dict[Ending | MachineState, bool]
"""The exits of a state: endings, or states that follow. The value is True if the state may be left
that way before any task has run.
"""


def endings_of(root: MachineState) -> dict[MachineState, list[Ending]]:
    """Return the endings that each state can have. Raises UnsoundMachine if the machine can't be
    run.
    """
    search = _Search()
    search.exits(root)
    return search.endings


class _Search:
    def __init__(self) -> None:
        self.endings: dict[MachineState, list[Ending]] = {}

    def exits(self, state: MachineState) -> Exits:
        """Return the exits of a state. An ending that leads to a state is replaced by that
        state.
        """
        _check_targets(state)
        inner = self._inner_exits(state)
        self.endings[state] = [ending for ending in ENDINGS if ending in inner]
        for ending in state.by_event:
            if ending not in self.endings[state]:
                possible = " or ".join(self.endings[state])
                only = f", only as {possible}" if possible else ""
                raise UnsoundMachine(
                    f"{state!r} can't end as {ending}{only}: remove on({ending}=...)"
                )
        found: Exits = {}
        for exit_, is_at_once in inner.items():
            to = exit_ if isinstance(exit_, MachineState) else state.target(exit_) or exit_
            found[to] = found.get(to, False) or is_at_once
        return found

    def _inner_exits(self, state: MachineState) -> Exits:
        """Return the exits of a state by the endings of its task, or by the exits of the states in
        it.
        """
        if state.kind is StateKind.TASK:
            return dict.fromkeys(ENDINGS, False)
        if state.kind is StateKind.EPSILON:
            return {"completed": True}
        if state.kind.is_concurrent:
            return self._exits_of_concurrence(state)
        return self._exits_of_successive(state)

    def _exits_of_concurrence(self, state: MachineState) -> Exits:
        if len(state.children) == 1:
            raise UnsoundMachine(
                f"{state!r} has only one state: add another, or remove the concurrence"
            )
        foreground = [branch for branch in state.children if any(map(_is_foreground, branch.all()))]
        if len(foreground) > 1:
            raise UnsoundMachine(
                f"{state!r}: {named(foreground)} would run in the foreground at the same time, "
                "and stop each other: give foreground=False to the tasks of all but one"
            )
        exits_of = {branch: self.exits(branch) for branch in state.children}
        for branch, exits in exits_of.items():
            if any(exits.values()):
                raise UnsoundMachine(
                    f"{branch!r} may end before any task in it has run, and would end {state!r}"
                )
        found = {
            exit_ for branch, exits in exits_of.items() for exit_ in exits if exit_ is not branch
        }
        if state.kind is StateKind.ALL and not all(
            "completed" in exits for exits in exits_of.values()
        ):
            found.discard("completed")
        return dict.fromkeys(found, False)

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


def _check_targets(state: MachineState) -> None:
    """Check that no transition leads into a container from outside it, nor to a state that runs at
    the same time.
    """
    containers = list(state.containers())
    for arrow in state.arrows:
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
        raise UnsoundMachine(f"{state!r}: on({arrow.event}=...): {msg}")


def _is_foreground(state: MachineState) -> bool:
    return state.kind is StateKind.TASK and bool(state.parameters.get("foreground", True))
