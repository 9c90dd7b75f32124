"""The constraint arrows of a picture: one between two tasks, with the kinds of all constraints."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Self

from tca_tools.journal.at_time import RunAt
from tca_wire.constraints import Constraint
from tca_wire.points import Moment, describe_moments
from tca_wire.text.measures import duration, listed

SEQ = "SEQ"
DELAYED = "DP"
KINDS = {
    (Moment.END_ACHIEVING, Moment.START_ACHIEVING): SEQ,
    (Moment.END_PLANNING, Moment.START_PLANNING): "SEQ planning",
    (Moment.END_ACHIEVING, Moment.START_PLANNING): DELAYED,
    (Moment.START_ACHIEVING, Moment.START_PLANNING): "plan ahead",
}
_OWN_KINDS = {
    (Moment.START_ACHIEVING, Moment.START_PLANNING): DELAYED,
    (Moment.END_PLANNING, Moment.START_ACHIEVING): "plan first",
}
MEANINGS = {
    SEQ: "achieved one after the other",
    "SEQ planning": "planned one after the other",
    DELAYED: "planned only when it may be achieved",
    "plan ahead": "planned no earlier than the other is started",
    "plan first": "planned completely before it is started",
}


class ArrowKind(str):
    """The label of an arrow, ``SEQ + 3 s``; and its *name* without the delay."""

    __slots__ = ("name",)
    name: str

    def __new__(cls, name: str, delay: float = 0.0) -> Self:
        """Create a label with a delay in seconds (0: none)."""
        made = super().__new__(cls, f"{name} + {duration(delay)}" if delay else name)
        made.name = name
        return made


@dataclass(slots=True)
class Arrows:
    """The arrows for the constraints of a tree."""

    between: dict[tuple[int, int], list[ArrowKind]] = field(default_factory=dict)
    """For each two tasks, the kinds of the constraints between them."""
    own: dict[int, list[ArrowKind]] = field(default_factory=dict)
    """For each task, the kinds of constraints between its own moments. A kind that stands on an
    arrow to the task is left out.
    """
    unseen: dict[tuple[int, int], list[ArrowKind]] = field(default_factory=dict)
    """As *between*, but from tasks that are not shown, because they are folded or not selected."""

    @property
    def kinds(self) -> set[str]:
        """All kinds that occur, without delays."""
        parts = self.between, self.own, self.unseen
        return {kind.name for part in parts for kinds in part.values() for kind in kinds}


def arrows(at: RunAt, shown: set[int]) -> Arrows:
    """Return the arrows between the shown tasks."""
    found, delayed = Arrows(), ArrowKind(DELAYED)
    for task_id in sorted(shown):
        incoming: dict[int, list[ArrowKind]] = {}
        for constraint in at.tasks[task_id].constraints:
            before = constraint.before.task
            if before in at.tasks:
                _add(incoming.setdefault(before, []), kind_of_arrow(constraint))
        own = incoming.pop(task_id, [])
        sequence = next((kinds for kinds in incoming.values() if _is_sequence(kinds)), None)
        if DELAYED in own and sequence is not None:
            # "after it, and not even planned before" is one arrow, as in the literature
            own.remove(delayed)
            _add(sequence, delayed)
        known = _predecessors(at, incoming) if incoming.keys() - shown else set()
        for one, kinds in incoming.items():
            if one in shown:
                found.between[one, task_id] = kinds
            elif kinds != [SEQ] or one not in known:
                found.unseen[one, task_id] = kinds
        if own:
            found.own[task_id] = own
    _leave_out_detours(found.between)
    return found


def in_words(
    at: RunAt, found: Arrows, drawn: Mapping[tuple[int, int], Collection[ArrowKind]]
) -> dict[int, list[str]]:
    """Return each task's constraints in words, except the kinds that are *drawn* as arrows.

    For example ``plan first``, ``after walk {3} and look {4}``, ``plan ahead: after walk {3}``.
    """
    names: dict[tuple[int, str], list[str]] = {}
    for pair, kinds in (found.between | found.unseen).items():
        if rest := [kind for kind in kinds if kind not in drawn.get(pair, ())]:
            prefix = "" if rest == [SEQ] else f"{', '.join(rest)}: "
            names.setdefault((pair[1], prefix), []).append(at.describe(pair[0]))
    texts = {task: [", ".join(kinds)] for task, kinds in found.own.items()}
    for (task, prefix), befores in names.items():
        texts.setdefault(task, []).append(f"{prefix}after {listed(befores)}")
    return texts


def _predecessors(at: RunAt, tasks: Iterable[int]) -> set[int]:
    """Return the predecessors of *tasks*. A task that follows *tasks* follows these anyway."""
    constraints = (one for task in tasks for one in at.tasks[task].constraints)
    return {one.before.task for one in constraints if kind_of_arrow(one).name == SEQ}


def _leave_out_detours(between: dict[tuple[int, int], list[ArrowKind]]) -> None:
    """Remove arrows that skip a task.

    A kill creates them: the successors of a killed task then wait for its predecessors.
    """
    rows = {pair for pair, kinds in between.items() if _is_sequence(kinds)}
    following: dict[int, list[int]] = {}
    for before, after in rows:
        following.setdefault(before, []).append(after)
    for before, after in rows:
        if between[before, after] == [SEQ] and any(
            (one, after) in rows for one in following[before]
        ):
            del between[before, after]


def kind_of_arrow(constraint: Constraint) -> ArrowKind:
    """Return the label of the arrow for a constraint."""
    before, after = constraint.before, constraint.after
    names = _OWN_KINDS if before.task == after.task else KINDS
    first, second = (", ".join(describe_moments(point.moment)) for point in (before, after))
    name = names.get((before.moment, after.moment), f"{first} before {second}")
    return ArrowKind(name, constraint.delay)


def _is_sequence(kinds: list[ArrowKind]) -> bool:
    return any(kind.name == SEQ for kind in kinds)


def _add(kinds: list[ArrowKind], kind: ArrowKind) -> None:
    if kind not in kinds:
        kinds.append(kind)
