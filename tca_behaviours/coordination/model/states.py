"""A machine's states and arrows, as they are written."""

from collections.abc import Callable, Iterator
from typing import Any

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.likelihoods import Likelihood, LikelihoodModel, as_model
from tca_behaviours.coordination.model.situation import Situation, check_confidence
from tca_behaviours.statecharts.states import Arrow, name_of
from tca_behaviours.statecharts.writing import BlockState, short_line
from tca_module import Variable
from tca_module.checks import LABEL, ArgumentKind, check
from tca_wire.charts import StateKind

DONE, FAILED = "done", "failed"
"""The events of a state's own activity."""

Guard = Variable[Any] | Callable[[Situation], bool]
"""A guard holds if the variable is true or at least 0.5, or if the function returns True."""


class AuthoredState(BlockState["AuthoredState", "AuthoredArrow"]):
    """A state of a machine that is being written. ``to`` says which states follow it."""

    def __init__(
        self,
        kind: StateKind,
        label: str,
        parent: "AuthoredState | None",
        activity: Activity | None = None,
    ) -> None:
        super().__init__(kind, label, parent)
        self.activity = activity

    def lines(self) -> Iterator[str]:
        """Yield the tasks of the state's activity, with the agents that they need."""
        for task in self.activity.tasks if self.activity is not None else ():
            agents = "+".join(agent.name for agent in task.agents)
            yield short_line(task.text) + (f" ({agents})" if agents else "")

    def to(
        self,
        target: "AuthoredState | str",
        on: str = DONE,
        *,
        when: Guard | None = None,
        likelihood: Likelihood | None = None,
        guard_name: str = "",
    ) -> "AuthoredArrow":
        """Add an arrow to another state.

        If several arrows have the same event, the first whose guard holds is taken.

        Args:
            target: the state that follows, or its label.
            on: the event. Default: "done". "done" and "failed" are those of the state's activity.
            when: the guard: a variable that must be true or at least 0.5, or a function of the
                Situation.
            likelihood: how likely the arrow is: a model such as Prior(0.8), or a function.
            guard_name: the guard's name in texts. Default: the name of the variable or function.

        Returns:
            The arrow.

        Raises:
            MisuseError: an argument does not fit, or the machine is built.
        """
        check(f"{self!r}.to(...)", LABEL, on=on)
        if when is not None:
            guard_name = guard_name or _name_of_guard(when, f"{self!r}.to(..., on='{on}')")
        model = None if likelihood is None else as_model(likelihood)
        return self.add_arrow(AuthoredArrow(self, target, on, when, guard_name, model))

    def after(
        self,
        seconds: float,
        target: "AuthoredState | str",
        *,
        likelihood: Likelihood | None = None,
    ) -> "AuthoredArrow":
        """Add an arrow that is taken when the machine has been in this state for a time.

        Args:
            seconds: the time, from the entry into this state.
            target: the state that follows, or its label.
            likelihood: how likely the arrow is, as for ``to``.

        Returns:
            The arrow.

        Raises:
            MisuseError: an argument does not fit, the state has such an arrow, or the machine is
                built.

        Example::

            waiting.after(5.0, "give up")
        """
        model = None if likelihood is None else as_model(likelihood)
        return self.add_arrow(AuthoredArrow(self, target, "", None, "", model, seconds))


class AuthoredArrow(Arrow[AuthoredState]):
    """A transition of a machine that is being written."""

    def __init__(
        self,
        source: AuthoredState,
        target: AuthoredState | str,
        event: str,
        guard: Guard | None,
        guard_name: str,
        model: LikelihoodModel | None,
        after: float | None = None,
    ) -> None:
        super().__init__(source, target, event, (guard_name,) if guard is not None else (), after)
        self.guard = guard
        self.model = model

    @property
    def is_inherited(self) -> bool:
        """Whether the arrow also leaves the states inside its source. False for an arrow that is
        taken at the end of a compound.
        """
        return self.event != DONE or self.source.kind is not StateKind.COMPOUND

    @property
    def is_impossible(self) -> bool:
        """Whether the likelihood is the constant 0. Such an arrow is never taken."""
        return (
            self.model is not None
            and self.model.is_constant
            and self.model.value(Situation(), "", "") == 0
        )

    @property
    def variables(self) -> list[Variable[Any]]:
        """The variables that the arrow's guard and likelihood read."""
        of_guard = [self.guard] if isinstance(self.guard, Variable) else []
        of_model = self.model.variables if self.model is not None else ()
        return [*of_guard, *of_model]

    def holds(self, situation: Any = None) -> bool:
        """Return whether the guard allows the arrow in the present situation."""
        if self.guard is None:
            return True
        if isinstance(self.guard, Variable):
            return (situation.confidence(self.guard) or 0.0) >= 0.5
        return bool(self.guard(situation))


_FUNCTION = ArgumentKind("a Variable or a function of the Situation", callable)


def _name_of_guard(guard: Any, call: str) -> str:
    if isinstance(guard, Variable):
        check_confidence(guard, f"{call}: when=")
        return guard.name
    check(call, _FUNCTION, when=guard)
    return name_of(guard)
