"""A state of a machine, as it is written down: a task, a branching point, or a container of other states."""

from collections.abc import Iterator
from typing import Any, Self, get_args

from tca_module import MisuseError
from tca_wire.charts import Ending, StateKind

ENDINGS: tuple[Ending, ...] = get_args(Ending)


class UnsoundMachine(MisuseError):
    """A machine that can't be run as it is written; the text says which state is wrong, and what to do."""


class MachineState:
    """A state of a machine that is being written; ``on`` says which state follows it."""

    def __init__(self, kind: StateKind, label: str, parent: "MachineState | None") -> None:
        self.kind = kind
        self.label = label
        self.parent = parent
        self.children: list[MachineState] = []
        self.task = ""
        self.parameters: dict[str, Any] = {}
        self.is_open = True
        """Whether the machine is still being written."""
        self._named: dict[Ending, MachineState | str] = {}
        self.written: dict[Ending, MachineState] = {}
        """The states that ``on`` names, once the machine is built."""
        if parent is not None:
            parent.children.append(self)

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
        if not self.is_open:
            raise MisuseError(f"{self!r} is built: say on(...) inside the machine's with block")
        given = {"completed": completed, "failed": failed, "timeout": timeout, "interrupted": interrupted}
        for ending in ENDINGS:
            target = given[ending]
            if target is None:
                continue
            if not isinstance(target, MachineState | str):
                raise MisuseError(f"{self!r}: on({ending}=...) takes a state or its label, not {target!r:.60}")
            if ending in self._named:
                raise MisuseError(f"{self!r}: on({ending}=...) is said twice")
            self._named[ending] = target
        return self

    def resolve(self, labelled: "dict[str, MachineState]") -> None:
        """Find the states that ``on`` names by label; nothing can be written any more."""
        self.is_open = False
        for ending, target in self._named.items():
            if isinstance(target, str) and target not in labelled:
                known = ", ".join(f"'{label}'" for label in labelled)
                raise UnsoundMachine(f"{self!r}: on({ending}='{target}') names no state; there are {known}")
            self.written[ending] = labelled[target] if isinstance(target, str) else target

    def target(self, ending: Ending) -> "MachineState | None":
        """The state that follows an ending; None where the ending is passed on to the container."""
        if ending in self.written:
            return self.written[ending]
        if ending == "completed" and self.parent is not None and self.parent.kind is StateKind.SEQUENCE:
            brothers = self.parent.children
            return next(iter(brothers[brothers.index(self) + 1 :]), None)
        return None

    def around(self) -> "Iterator[MachineState]":
        """The containers that it stands in, innermost first."""
        if self.parent is not None:
            yield self.parent
            yield from self.parent.around()

    def all(self) -> "Iterator[MachineState]":
        """Itself and all inside, in the order in which they were written."""
        yield self
        for child in self.children:
            yield from child.all()


class ContainerState(MachineState):
    """A state that holds others: those that are written inside its ``with`` block."""

    def __init__(
        self, kind: StateKind, label: str, parent: MachineState | None, written: "list[ContainerState]"
    ) -> None:
        """*written*: the containers in which the machine is being written, innermost last."""
        super().__init__(kind, label, parent)
        self._written = written

    def __enter__(self) -> Self:
        if not self.is_open or self.children:
            raise MisuseError(f"{self!r} is written in one with block; make another one")
        self._written.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        self._written.pop()
