"""A machine's states and arrows, as they are written down."""

from collections.abc import Callable, Iterator
from typing import Any

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.likelihoods import Likelihood, LikelihoodModel, as_model
from tca_behaviours.coordination.model.situation import Situation, check_confidence
from tca_behaviours.statecharts.states import Arrow, name_of
from tca_behaviours.statecharts.writing import BlockState, line
from tca_module import Variable
from tca_module.checks import LABEL, ArgumentKind, check
from tca_wire.charts import StateKind

DONE, FAILED = "done", "failed"
"""The events of a state's own activity."""

Guard = Variable[Any] | Callable[[Situation], bool]
"""It holds if the variable is true, or 0.5 at least; or if the function says so."""


class AuthoredState(BlockState["AuthoredState", "AuthoredArrow"]):
    """A state of a machine that is being written; ``to`` says which state follows it."""

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
        """Its tasks, with the agents that they need."""
        for task in self.activity.tasks if self.activity is not None else ():
            agents = "+".join(agent.name for agent in task.agents)
            yield line(task.text) + (f" ({agents})" if agents else "")

    def to(
        self,
        target: "AuthoredState | str",
        on: str = DONE,
        *,
        when: Guard | None = None,
        likelihood: Likelihood | None = None,
        guard_name: str = "",
    ) -> "AuthoredArrow":
        """An arrow to another state, or to the one of that label. It is taken at the event *on*, if
        *when* holds; of several with one event the first whose guard holds. *guard_name*: for
        texts, instead of the guard's own name.
        """
        check(f"{self!r}.to(...)", LABEL, on=on)
        name = guard_name or _name(when, f"{self!r}.to(..., on='{on}')") if when is not None else ""
        model = None if likelihood is None else as_model(likelihood)
        return self.add_arrow(AuthoredArrow(self, target, on, when, name, model))


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
    ) -> None:
        super().__init__(source, target, event, (guard_name,) if guard is not None else ())
        self.guard = guard
        self.model = model

    @property
    def is_inherited(self) -> bool:
        """Whether the states inside its own obey it; not where it leads on from the end of a
        compound.
        """
        return self.event != DONE or self.source.kind is not StateKind.COMPOUND

    @property
    def is_impossible(self) -> bool:
        """Whether its author says that it is never taken: its likelihood is 0, and does not
        change.
        """
        return (
            self.model is not None
            and self.model.is_constant
            and self.model.value(Situation(), "", "") == 0
        )

    @property
    def variables(self) -> list[Variable[Any]]:
        """The variables that its guard and its likelihood look at."""
        of_guard = [self.guard] if isinstance(self.guard, Variable) else []
        return [*of_guard, *(self.model.variables if self.model is not None else ())]

    def holds(self, now: Any = None) -> bool:
        """Whether it may be taken, as things are."""
        if self.guard is None:
            return True
        if isinstance(self.guard, Variable):
            return (now.confidence(self.guard) or 0.0) >= 0.5
        return bool(self.guard(now))


_FUNCTION = ArgumentKind("a Variable or a function of the Situation", callable)


def _name(guard: Any, place: str) -> str:
    if isinstance(guard, Variable):
        check_confidence(guard, f"{place}: when=")
        return guard.name
    check(place, _FUNCTION, when=guard)
    return name_of(guard)
