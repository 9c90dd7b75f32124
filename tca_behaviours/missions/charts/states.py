"""A state of a machine, as it is written: a task, a Python function, a branching point, or a
container of other states.
"""

from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any, Self, get_args

from msgspec.structs import replace

from tca_behaviours.missions.charts.policies import Policy
from tca_behaviours.missions.charts.user_data import FromData, UserData
from tca_behaviours.statecharts.states import Arrow, UnsoundMachine, name_of
from tca_behaviours.statecharts.writing import BlockState, short_line
from tca_module import MisuseError
from tca_module.checks import LABEL, check, quoted
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
        self.server = ""
        """The server of its task; "" for that of the mission."""
        self.function: Callable[[UserData], str | None] | None = None
        """The function that a Python state calls."""
        self.outcomes: tuple[str, ...] = ()
        """The outcomes that a Python state returns, or that a container has of its own."""
        self.remap: Mapping[str, str] = {}
        """By the name of user data in this state: the name around it."""
        self.end_name = ""
        """The user data that get the end of the task; "" for none."""
        self.policy: Policy | None = None
        """When a concurrence ends."""
        self.endings: list[str] = []
        """The possible endings of the state, once the machine is built."""

    def __repr__(self) -> str:
        kind = "concurrence" if self.kind.is_concurrent else self.kind
        is_leaf = self.kind in (StateKind.TASK, StateKind.CALL)
        return f"'{self.label}'" if is_leaf else f"{kind} '{self.label}'"

    def on(
        self,
        *unnamed: object,
        completed: "MachineState | str | None" = None,
        failed: "MachineState | str | None" = None,
        timeout: "MachineState | str | None" = None,
        interrupted: "MachineState | str | None" = None,
        **own: "MachineState | str | None",
    ) -> Self:
        """Set the states that follow this one, each given as a state or its label.

        An ending may also lead to an outcome of the container of this state: "completed",
        "failed", "timeout", "interrupted", or one of the container's own. An ending that is not
        given here ends the container in the same way. But *completed* leads to the next state if
        the container is a sequence.

        Args:
            unnamed: nothing: states are given by ending.
            completed: the state that follows when this one has completed.
            failed: the state that follows when it has failed.
            timeout: the state that follows when it ran too long.
            interrupted: the state that follows when it was stopped from outside.
            own: the states that follow outcomes of its own, by outcome.

        Returns:
            This state.

        Raises:
            MisuseError: an ending has a successor already, a state is given without an ending, or
                the machine is built.

        Example::

            sm.GoTo(goal_x=1.0).on(timeout="home", failed="home")
        """
        if unnamed:
            raise MisuseError(
                f"{self!r}: on() takes states by ending: on(completed={unnamed[0]!r:.60})"
            )
        usual = zip(ENDINGS, (completed, failed, timeout, interrupted), strict=True)
        for ending, target in (*usual, *own.items()):
            if ending in self.by_event and target is not None:
                raise MisuseError(f"{self!r}: on({ending}=...) is given twice: remove one")
            if target is not None:
                self.add_arrow(EndingArrow(self, target, ending))
        return self

    def after(self, seconds: float, target: "MachineState | str") -> Self:
        """Leave the state when the machine has been in it for a time. Its tasks are stopped.

        Args:
            seconds: the time, from the entry into this state.
            target: the state that follows, its label, or an outcome of the container.

        Returns:
            This state.

        Raises:
            MisuseError: the time is not above 0, or is given twice.

        Example::

            sm.Listen().after(5.0, "timeout")
        """
        self.add_arrow(EndingArrow(self, target, "", after=seconds))
        return self

    def keep_end(self, name: str) -> Self:
        """Put the end of the state's task, a TaskEnd, into the user data.

        Args:
            name: the name of the user data.

        Returns:
            This state.

        Example::

            sm.Weigh(grams=[2, 3]).keep_end("weight")
        """
        check(f"{self!r}.keep_end", LABEL, name=name)
        if self.kind is not StateKind.TASK:
            raise MisuseError(f"{self!r} has no task whose end could be kept: remove keep_end()")
        self.end_name = name
        return self

    def follower(self, ending: str) -> "MachineState | str":
        """Return what follows an ending of this state.

        Args:
            ending: "completed", "failed", "timeout", "interrupted", or an outcome of its own.

        Returns:
            The next state; an ending of the container if the ending is passed on to it.
        """
        if ending in self.by_event:
            return self.by_event[ending][0].end
        parent = self.parent
        if ending == "completed" and parent is not None and parent.kind is StateKind.SEQUENCE:
            return next(iter(parent.children[parent.children.index(self) + 1 :]), ending)
        return ending

    def data(self, values: MutableMapping[str, Any]) -> UserData:
        """Return the machine's user data as this state sees them."""
        names = [state.remap for state in (self, *self.containers())]
        return UserData(values, repr(self), names)

    def parameters_from(self, values: MutableMapping[str, Any]) -> dict[str, Any]:
        """Return the parameters of the task, with the present user data."""
        data = self.data(values)
        return {
            name: getattr(data, value.name) if isinstance(value, FromData) else value
            for name, value in self.parameters.items()
        }

    def lines(self) -> Iterator[str]:
        """Yield a line for each parameter of the state's task."""
        shown = list(self.parameters.items())
        for name, value in shown[:_MOST_PARAMETERS]:
            yield short_line(f"{name} = {value}")
        if len(shown) > _MOST_PARAMETERS:
            yield f"and {len(shown) - _MOST_PARAMETERS} more"
        for outcome, row in self.policy.outcome_map.items() if self.policy is not None else ():
            yield short_line(f"{outcome}: " + ", ".join(map(" ".join, row.items())))

    def chart_state(self) -> ChartState:
        """Return the state as data, once the states are numbered."""
        kind = self.task or (name_of(self.function) if self.function is not None else self.kind)
        # A default label, such as "GoTo 2", names the kind already.
        is_obvious = self.label.rstrip("0123456789 ") == kind or kind is StateKind.EPSILON
        on_server = f"{kind} on {self.server}"
        note = on_server if self.server else "" if is_obvious else kind
        is_last = "completed" in self.exits
        completes = is_last and self.parent is not None and not self.parent.kind.is_concurrent
        return replace(super().chart_state(), note=note, completes=completes)

    @property
    def exits(self) -> "list[MachineState | str]":
        """The states and endings of the container that may follow this state."""
        timed = [self.timed.end] if self.timed is not None else []
        return [*map(self.follower, self.endings), *timed]

    def chart_arrows(self) -> Iterator[ChartArrow]:
        """Yield the transitions that lead out of this state, as data. In a sequence, the step to
        the next state is one of them.
        """
        for ending in self.endings:
            if isinstance(to := self.follower(ending), MachineState):
                yield ChartArrow(self.number, to.number, "" if ending == "completed" else ending)
        if self.timed is not None and not self.timed.outcome:
            yield ChartArrow(self.number, self.timed.target.number, self.timed.symbol)


class EndingArrow(Arrow[MachineState]):
    """A transition that follows an ending of a state, or a time in it."""

    outcome = ""
    """The outcome of the container that the arrow leads to; "" if it leads to a state."""

    def __repr__(self) -> str:
        if self.after is not None:
            return super().__repr__()
        return f"{self.source!r}: on({self.event}={self.label!r})"

    @property
    def call(self) -> str:
        """The start of the call that wrote the arrow, for errors."""
        return f"on({self.event}=...)" if self.after is None else f"after({self.after!r}, ...)"

    @property
    def end(self) -> MachineState | str:
        """The state or the outcome of the container that the arrow leads to."""
        return self.outcome or self.target

    def resolve(self, labelled: dict[str, MachineState]) -> None:
        """Find the state or outcome. Raises UnsoundMachine if there is none."""
        container = self.source.parent
        own = container.outcomes if container is not None else ()
        if self.label not in labelled and self.label in (*ENDINGS, *own):
            self.outcome = self.label
            return
        try:
            super().resolve(labelled)
        except UnsoundMachine as error:
            if own:
                raise UnsoundMachine(f"{error}; outcomes are {quoted(own)}") from None
            raise
