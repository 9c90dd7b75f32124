"""Whether an activity may run before its turn, by the facts that hold, are needed and are made."""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import NamedTuple

from tca_coordination.model.situation import Fact


class Reason(StrEnum):
    """What speaks against an activity before its turn."""

    NOT_FORESEEN = "not foreseen"
    """Its state is not on the preview list any more."""
    REPEATED = "repeated"
    """Its state is the current one, or stands earlier in the list: the machine comes back to it."""
    NEEDS = "needs"
    """A fact that it needs does not hold now, or holds only because of early work that may be in vain."""
    CONFLICT = "conflict"
    """An activity that comes before it, or that runs, makes or needs the same variable; or its tasks of last time have
    not ended.
    """
    BRANCH = "branch"
    """On another branch, a state may need what it changes, and it can't be undone."""
    AGENT = "agent"
    """An agent of it has no place left."""
    UTILITY = "utility"
    """The policy finds it not worth while."""
    FAILED = "failed"
    """It has been tried ahead, and has failed."""


class Objection(NamedTuple):
    """What speaks against the activity of a state."""

    state: int
    reason: Reason
    name: str = ""
    """Of the variable or agent that it is about."""
    other: int = -1
    """The state of the activity with which it is in conflict."""


class Clash(NamedTuple):
    """A variable that two activities may not both have, and the state of the other one."""

    variable: str
    state: int


class Reservations:
    """The variables of activities that come first or run: later ones leave them alone."""

    def __init__(self) -> None:
        self._needed: dict[str, int] = {}  # by variable, the state whose activity needs it
        self._made: dict[str, int] = {}
        self._being_made: dict[str, int] = {}  # of these, what is not done

    def add(self, state: int, needs: Iterable[str], makes: Iterable[str], *, is_done: bool = False) -> None:
        """Reserve the variables of an activity. One that is *done* keeps what it has made, for others to build on."""
        for variable in needs:
            self._needed.setdefault(variable, state)
        for variable in makes:
            self._made.setdefault(variable, state)
            if not is_done:
                self._being_made.setdefault(variable, state)

    def clash(self, needs: Iterable[str], makes: Iterable[str]) -> Clash | None:
        """The first variable that stands against an activity, if any."""
        for variable in makes:
            for reserved in (self._made, self._needed):
                if variable in reserved:
                    return Clash(variable, reserved[variable])
        for variable in needs:
            if variable in self._being_made:
                return Clash(variable, self._being_made[variable])
        return None


def holds(variable: str, value: Fact, facts: Mapping[str, Fact]) -> bool:
    """Whether a variable is known to have this value."""
    return variable in facts and facts[variable] == value
