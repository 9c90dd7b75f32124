"""A machine's states and arrows, as they are written down."""

from collections.abc import Callable, Iterator
from typing import Any, Self

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.errors import UnsoundCoordination
from tca_behaviours.coordination.model.likelihoods import Likelihood, LikelihoodModel, as_model
from tca_behaviours.coordination.model.situation import Situation, check_confidence
from tca_module import MisuseError, Variable
from tca_wire.coordination import ActivityKind

DONE, FAILED = "done", "failed"
"""The events of a state's own activity."""

Guard = Variable[Any] | Callable[[Situation], bool]
"""It holds if the variable is true, or 0.5 at least; or if the function says so."""


class AuthoredState:
    """A state of a machine that is being written; ``to`` says which state follows it."""

    def __init__(
        self, kind: ActivityKind, label: str, parent: "CompoundState | None", activity: Activity | None = None
    ) -> None:
        self.kind = kind
        self.label = label
        self.parent = parent
        self.activity = activity
        self.arrows: list[AuthoredArrow] = []
        self.children: list[AuthoredState] = []
        self.number = -1
        """Its place in the chart, when the machine is built."""
        if parent is not None:
            parent.children.append(self)

    def __repr__(self) -> str:
        return f"'{self.label}'"

    def to(
        self,
        target: "AuthoredState | str",
        on: str = DONE,
        *,
        when: Guard | None = None,
        likelihood: Likelihood | None = None,
        guard_name: str = "",
    ) -> "AuthoredArrow":
        """An arrow to another state, or to the one of that label. It is taken at the event *on*, if *when* holds; of
        several with one event the first whose guard holds. *guard_name*: for texts, instead of the guard's own name.
        """
        if self.number != -1:
            raise MisuseError(f"state {self!r} is built: write its arrows inside the machine's with block")
        if not isinstance(target, AuthoredState | str):
            raise MisuseError(f"{self!r}.to(...) takes a state or its label, not {target!r:.60}")
        if not isinstance(on, str) or not on.strip():
            raise MisuseError(f"{self!r}.to({_label(target)!r}): on must be the name of an event, not {on!r:.60}")
        arrow = AuthoredArrow(self, target, on, when, likelihood, guard_name)
        self.arrows.append(arrow)
        return arrow

    def around(self) -> "Iterator[CompoundState]":
        """The compounds that it stands in, innermost first."""
        if self.parent is not None:
            yield self.parent
            yield from self.parent.around()

    def all(self) -> "Iterator[AuthoredState]":
        """Itself and all inside, in the order in which they were written."""
        yield self
        for child in self.children:
            yield from child.all()

    @property
    def leaf(self) -> "AuthoredState":
        """The state that is current when this one is entered."""
        return self.children[0].leaf if self.children else self


class CompoundState(AuthoredState):
    """A state that holds others: those that are written inside its ``with`` block. The first of them is entered."""

    def __init__(self, label: str, parent: "CompoundState | None", written: "list[CompoundState]") -> None:
        """*written*: the compounds that are open, innermost last."""
        super().__init__(ActivityKind.COMPOUND, label, parent)
        self._written = written

    def __enter__(self) -> Self:
        if self.number != -1 or self.children:
            raise MisuseError(f"{self!r} is written in one with block; make another one")
        self._written.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        self._written.pop()


class AuthoredArrow:
    """A transition of a machine that is being written."""

    def __init__(
        self,
        source: AuthoredState,
        target: AuthoredState | str,
        event: str,
        guard: Guard | None,
        likelihood: Likelihood | None,
        guard_name: str,
    ) -> None:
        self.source = source
        self.event = event
        self.guard = guard
        self.model: LikelihoodModel | None = None if likelihood is None else as_model(likelihood)
        self._named = target
        self._target: AuthoredState | None = None
        if guard is None:
            self.symbol = event
        else:
            self.symbol = f"{event} [{guard_name or self._name_of_guard(guard)}]"

    def __repr__(self) -> str:
        return f"{self.source!r}.to({_label(self._named)!r}, on='{self.event}')"

    def _name_of_guard(self, guard: Any) -> str:
        if isinstance(guard, Variable):
            check_confidence(guard, f"{self!r}: when=")
            return guard.name
        if not callable(guard):
            raise MisuseError(f"{self!r}: when must be a Variable or a function of the Situation, not {guard!r:.60}")
        return getattr(guard, "__name__", type(guard).__name__)

    @property
    def target(self) -> AuthoredState:
        """Where it leads."""
        assert self._target is not None, "resolve() comes first"
        return self._target

    @property
    def is_impossible(self) -> bool:
        """Whether its author says that it is never taken: its likelihood is 0, and does not change."""
        return self.model is not None and self.model.is_constant and self.model.value(Situation(), "", "") == 0

    @property
    def variables(self) -> list[Variable[Any]]:
        """The variables that its guard and its likelihood look at."""
        of_guard = [self.guard] if isinstance(self.guard, Variable) else []
        return [*of_guard, *(self.model.variables if self.model is not None else ())]

    def holds(self, situation: Situation) -> bool:
        """Whether it may be taken, as things are."""
        if self.guard is None:
            return True
        if isinstance(self.guard, Variable):
            return (situation.confidence(self.guard) or 0.0) >= 0.5
        return bool(self.guard(situation))

    def resolve(self, labelled: dict[str, AuthoredState]) -> None:
        """Find the state that it leads to."""
        label = _label(self._named)
        target = labelled.get(label)
        if target is None or (isinstance(self._named, AuthoredState) and target is not self._named):
            known = ", ".join(f"'{label}'" for label in labelled)
            raise UnsoundCoordination(f"{self!r} names no state of this machine; there are {known}")
        self._target = target


def _label(target: AuthoredState | str) -> str:
    return target if isinstance(target, str) else target.label
