"""What must be true of a machine before it may run.

The search goes from the inside out: how a container can be left follows from how the states in it
can.
"""

from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.statecharts.soundness import (
    all_reached,
    check_all_reached,
    check_no_circle,
    named,
)
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_wire.charts import Ending, StateKind

Exits = dict[Ending | MachineState, bool]
"""The endings of a state, or the states that follow it; and whether it may be left so before any
task has run.
"""


def endings_of(root: MachineState) -> dict[MachineState, list[Ending]]:
    """The endings that each state can have. Raises UnsoundMachine if the machine can't be run."""
    search = _Search()
    search.exits(root)
    return search.endings


class _Search:
    def __init__(self) -> None:
        self.endings: dict[MachineState, list[Ending]] = {}

    def exits(self, state: MachineState) -> Exits:
        """How a state can be left, where each ending that leads somewhere is that place."""
        _check_targets(state)
        inside = self._inside(state)
        self.endings[state] = [ending for ending in ENDINGS if ending in inside]
        for ending in state.by_event:
            if ending not in self.endings[state]:
                ends = " or ".join(self.endings[state]) or "never"
                raise UnsoundMachine(
                    f"{state!r} can't end as {ending}: it ends as {ends}; leave out on({ending}=...)"
                )
        found: Exits = {}
        for exit_, is_idle in inside.items():
            to = exit_ if isinstance(exit_, MachineState) else state.target(exit_) or exit_
            found[to] = found.get(to, False) or is_idle
        return found

    def _inside(self, state: MachineState) -> Exits:
        if state.kind is StateKind.TASK:
            return dict.fromkeys(ENDINGS, False)
        if state.kind is StateKind.EPSILON:
            return {"completed": True}
        return self._concurrence(state) if state.kind.is_concurrent else self._one_at_a_time(state)

    def _concurrence(self, state: MachineState) -> Exits:
        if len(state.children) == 1:
            raise UnsoundMachine(
                f"{state!r} has one state only: give it another, or leave the concurrence out"
            )
        in_front = [branch for branch in state.children if any(map(_is_in_front, branch.all()))]
        if len(in_front) > 1:
            msg = f"{state!r}: {named(in_front)} would run in the foreground at once, and stop each other"
            raise UnsoundMachine(f"{msg}: give all tasks of all but one foreground=False")
        left = {branch: self.exits(branch) for branch in state.children}
        for branch, exits in left.items():
            if any(exits.values()):
                raise UnsoundMachine(
                    f"{branch!r} may end before any task in it has run, and {state!r} with it"
                )
        found = {exit_ for branch, exits in left.items() for exit_ in exits if exit_ is not branch}
        if state.kind is StateKind.ALL and not all("completed" in exits for exits in left.values()):
            found.discard("completed")
        return dict.fromkeys(found, False)

    def _one_at_a_time(self, state: MachineState) -> Exits:
        left = {child: self.exits(child) for child in state.children}
        follow = {child: [to for to in exits if to in left] for child, exits in left.items()}
        reached = all_reached(state.children[0], follow.__getitem__)
        check_all_reached([child for child in left if child not in reached])
        idle = {
            child: [to for to, is_idle in exits.items() if is_idle and to in left]
            for child, exits in left.items()
        }
        check_no_circle(idle)
        at_once = all_reached(state.children[0], idle.__getitem__)
        found: Exits = {}
        for child, exits in left.items():
            for to, is_idle in exits.items():
                if to not in left:
                    found[to] = found.get(to, False) or (is_idle and child in at_once)
        return found


def _check_targets(state: MachineState) -> None:
    """A transition leads to a state beside its own, or beside a container of that; never into a
    container.
    """
    around = list(state.around())
    for arrow in state.arrows:
        target = arrow.target
        if target is state or target in around:
            continue  # it begins again
        assert target.parent is not None, "the whole machine has no label"
        if target.parent not in around:
            msg = f"{target!r} is inside {target.parent!r}: only states beside {state!r}, or around it, can follow"
        elif target.parent.kind.is_concurrent:
            msg = f"{target!r} runs beside it in {target.parent!r}, and can't follow"
        else:
            continue
        raise UnsoundMachine(f"{state!r}: on({arrow.event}=...): {msg}")


def _is_in_front(state: MachineState) -> bool:
    return state.kind is StateKind.TASK and bool(state.parameters.get("foreground", True))
