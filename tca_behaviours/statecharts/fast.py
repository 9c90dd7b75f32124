"""Our own interpreter of machines of events: a tick is short, and makes one transition at most (decision 95)."""

from collections.abc import Sequence
from typing import Any, Generic

from tca_behaviours.statecharts.states import A, S


class FastInterpreter(Generic[S, A]):
    """A machine of events at work; with the interface of ``LibraryInterpreter``, which is its oracle."""

    def __init__(self, root: S) -> None:
        """*root*: the container that is the whole machine."""
        self.root = root
        self.active: tuple[S, ...] = ()
        """The active states, innermost first."""

    def restart(self) -> None:
        """Begin in the first leaf."""
        self.reset()
        self.enter_first()

    def reset(self) -> None:
        """Go to the first leaf, without entry functions."""
        self._leave()
        self._go_to(self.root.leaf, "")

    def enter_first(self) -> None:
        """Call the entry functions of the states in which it begins."""
        for state in reversed(self.active):
            if state.entry is not None:
                state.entry()

    def take(self, event: str, now: Any = None) -> Sequence[A]:
        """Tell it of an event; guards look at *now*. The arrow that was taken, if any: of the innermost state first,
        then in the order written.
        """
        for state in self.active:
            for arrow in state.by_event.get(event, ()):
                if arrow.holds(now):
                    self._make(arrow)
                    return (arrow,)
        return ()

    def _make(self, arrow: A) -> None:
        """Leave states up to the one around both ends, and enter those down to the target. The machine is whole
        whatever an exit or entry function raises: still there, or there already.
        """
        staying = arrow.around
        for state in self.active:
            if state not in staying and state.exit is not None:
                state.exit()
        self._go_to(arrow.target.leaf, arrow.event)
        for state in reversed(self.active):
            if state not in staying and state.entry is not None:
                state.entry()

    def _go_to(self, leaf: S, event: str) -> None:
        source = self.active[0] if self.active else self.root
        self._leave()
        self.active = leaf.path
        for state in self.active:
            state.is_active = True
        self._note(source, leaf, event)

    def _leave(self) -> None:
        for state in self.active:
            state.is_active = False
        self.active = ()

    def _note(self, source: S, leaf: S, event: str) -> None:
        """It has gone from one leaf, or from the whole, to another."""
