"""A state of a machine, as it is written down: a task, a branching point, or a container of other states."""

from typing import Any, Self, get_args

from tca_behaviours.statecharts.states import Arrow
from tca_behaviours.statecharts.writing import BlockState
from tca_module import MisuseError
from tca_wire.charts import Ending, StateKind

ENDINGS: tuple[Ending, ...] = get_args(Ending)


class MachineState(BlockState["MachineState", "EndingArrow"]):
    """A state of a machine that is being written; ``on`` says which state follows it."""

    def __init__(self, kind: StateKind, label: str, parent: "MachineState | None") -> None:
        super().__init__(kind, label, parent)
        self.task = ""
        self.parameters: dict[str, Any] = {}

    def __repr__(self) -> str:
        kind = "concurrence" if self.kind.is_concurrent else self.kind
        return f"'{self.label}'" if self.kind is StateKind.TASK else f"{kind} '{self.label}'"

    def on(
        self,
        *,
        completed: "MachineState | str | None" = None,
        failed: "MachineState | str | None" = None,
        timeout: "MachineState | str | None" = None,
        interrupted: "MachineState | str | None" = None,
    ) -> Self:
        """The state, or the label of one, that follows when this one has ended so. Without, a *completed* state of a
        sequence leads to the next, and any other ending is that of the container.
        """
        for ending, target in zip(ENDINGS, (completed, failed, timeout, interrupted), strict=True):
            if ending in self.by_event and target is not None:
                raise MisuseError(f"{self!r}: on({ending}=...) is said twice")
            if target is not None:
                self.lead(EndingArrow(self, target, ending))
        return self

    def target(self, ending: Ending) -> "MachineState | None":
        """The state that follows an ending; None where the ending is passed on to the container."""
        if ending in self.by_event:
            return self.by_event[ending][0].target
        if ending == "completed" and self.parent is not None and self.parent.kind is StateKind.SEQUENCE:
            brothers = self.parent.children
            return next(iter(brothers[brothers.index(self) + 1 :]), None)
        return None


class EndingArrow(Arrow[MachineState]):
    """A transition that follows an ending of a state."""

    def __repr__(self) -> str:
        return f"{self.source!r}: on({self.event}={self.label!r})"
