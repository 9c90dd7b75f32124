"""A state of a machine, as it is written: a task, a branching point, or a container of other
states.
"""

from collections.abc import Iterator
from typing import Any, Self, get_args

from msgspec.structs import replace

from tca_behaviours.statecharts.states import Arrow
from tca_behaviours.statecharts.writing import BlockState, short_line
from tca_module import MisuseError
from tca_wire.charts import ChartArrow, ChartState, Ending, StateKind

_MOST_PARAMETERS = 6
"""The most parameters of a task that a picture shows."""
ENDINGS: tuple[Ending, ...] = get_args(Ending)


class MachineState(BlockState["MachineState", "EndingArrow"]):
    """A state of a machine that is being written. ``on`` says which states follow it."""

    def __init__(self, kind: StateKind, label: str, parent: "MachineState | None") -> None:
        super().__init__(kind, label, parent)
        self.task = ""
        self.parameters: dict[str, Any] = {}
        self.endings: list[Ending] = []
        """The possible endings of the state, once the machine is built."""

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
        """Set the states that follow this one, each given as a state or its label.

        An ending that is not given here ends the container of this state in the same way. But
        *completed* leads to the next state if the container is a sequence.

        Args:
            completed: the state that follows when this one has completed.
            failed: the state that follows when it has failed.
            timeout: the state that follows when it ran too long.
            interrupted: the state that follows when it was stopped from outside.

        Returns:
            This state.

        Raises:
            MisuseError: an ending has a successor already, or the machine is built.

        Example::

            sm.GoTo(goal_x=1.0).on(timeout="home", failed="home")
        """
        for ending, target in zip(ENDINGS, (completed, failed, timeout, interrupted), strict=True):
            if ending in self.by_event and target is not None:
                raise MisuseError(f"{self!r}: on({ending}=...) is given twice: remove one")
            if target is not None:
                self.add_arrow(EndingArrow(self, target, ending))
        return self

    def target(self, ending: Ending) -> "MachineState | None":
        """Return the state that follows an ending.

        Args:
            ending: "completed", "failed", "timeout" or "interrupted".

        Returns:
            The state; None if the ending is passed on to the container.
        """
        if ending in self.by_event:
            return self.by_event[ending][0].target
        parent = self.parent
        if ending == "completed" and parent is not None and parent.kind is StateKind.SEQUENCE:
            return next(iter(parent.children[parent.children.index(self) + 1 :]), None)
        return None

    def lines(self) -> Iterator[str]:
        """Yield a line for each parameter of the state's task."""
        shown = list(self.parameters.items())
        for name, value in shown[:_MOST_PARAMETERS]:
            yield short_line(f"{name} = {value}")
        if len(shown) > _MOST_PARAMETERS:
            yield f"and {len(shown) - _MOST_PARAMETERS} more"

    def chart_state(self) -> ChartState:
        """Return the state as data, once the states are numbered."""
        kind = self.task or self.kind
        # A default label, such as "GoTo 2", names the kind already.
        is_obvious = self.label.rstrip("0123456789 ") == kind or kind is StateKind.EPSILON
        is_last = "completed" in self.endings and self.target("completed") is None
        completes = is_last and self.parent is not None and not self.parent.kind.is_concurrent
        return replace(super().chart_state(), note="" if is_obvious else kind, completes=completes)

    def chart_arrows(self) -> Iterator[ChartArrow]:
        """Yield the transitions that lead out of this state, as data. In a sequence, the step to
        the next state is one of them.
        """
        for ending in self.endings:
            if (to := self.target(ending)) is not None:
                yield ChartArrow(self.number, to.number, "" if ending == "completed" else ending)


class EndingArrow(Arrow[MachineState]):
    """A transition that follows an ending of a state."""

    def __repr__(self) -> str:
        return f"{self.source!r}: on({self.event}={self.label!r})"
