"""The checks of a machine before it may run.

The search goes from the inside out: the exits of a container follow from those of the states in it.
"""

from tca_behaviours.missions.charts.states import ENDINGS, MachineState
from tca_behaviours.statecharts.soundness import (
    all_reached,
    check_all_reached,
    check_no_cycle,
    named,
)
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_wire.charts import Ending, StateKind

Exits = dict[Ending | MachineState, bool]
"""The exits of a state: an ending, or the state that follows. The value says whether the state may
be left that way before any task has run.
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
        """The exits of a state. An ending that leads to a state is replaced by that state."""
        _check_targets(state)
        inside = self._inside(state)
        self.endings[state] = [ending for ending in ENDINGS if ending in inside]
        for ending in state.by_event:
            if ending not in self.endings[state]:
                possible = " or ".join(self.endings[state])
                only = f", only as {possible}" if possible else ""
                raise UnsoundMachine(
                    f"{state!r} can't end as {ending}{only}: remove on({ending}=...)"
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

    def _one_at_a_time(self, state: MachineState) -> Exits:
        exits_of = {child: self.exits(child) for child in state.children}
        follow = {
            child: [to for to in exits if to in exits_of] for child, exits in exits_of.items()
        }
        reached = all_reached(state.children[0], follow.__getitem__)
        check_all_reached([child for child in exits_of if child not in reached])
        idle = {
            child: [to for to, is_idle in exits.items() if is_idle and to in exits_of]
            for child, exits in exits_of.items()
        }
        check_no_cycle(idle)
        at_once = all_reached(state.children[0], idle.__getitem__)
        found: Exits = {}
        for child, exits in exits_of.items():
            for to, is_idle in exits.items():
                if to not in exits_of:
                    found[to] = found.get(to, False) or (is_idle and child in at_once)
        return found


def _check_targets(state: MachineState) -> None:
    """Check that each transition leads to a state beside its own, or beside a container around it.

    No transition leads into a container.
    """
    containers = list(state.containers())
    for arrow in state.arrows:
        target = arrow.target
        if target is state or target in containers:
            continue  # it is entered again
        assert target.parent is not None, "the whole machine has no label"
        if target.parent not in containers:
            msg = (
                f"{target!r} is inside {target.parent!r}: "
                f"lead to a state beside or around {state!r}"
            )
        elif target.parent.kind.is_concurrent:
            msg = f"{target!r} runs beside it in {target.parent!r}, and can't follow it"
        else:
            continue
        raise UnsoundMachine(f"{state!r}: on({arrow.event}=...): {msg}")


def _is_foreground(state: MachineState) -> bool:
    return state.kind is StateKind.TASK and bool(state.parameters.get("foreground", True))
