"""Reservations of early activities: variables, and places at agents. Earlier activities get them
first.
"""

from collections import Counter
from collections.abc import Iterable

from tca_behaviours.coordination.model.activities import Agent, Do
from tca_wire.coordination import Objection, Reason


class Reservations:
    """The variables of activities that come first or run. Later activities must not change them."""

    def __init__(self) -> None:
        self._needed: dict[str, int] = {}  # by variable, the state whose activity needs it
        self._made: dict[str, int] = {}
        self._being_made: dict[str, int] = {}  # the part of _made that is not done

    def add(
        self, state: int, needs: Iterable[str], makes: Iterable[str], *, is_done: bool = False
    ) -> None:
        """Reserve the variables of an activity. If it is *done*, later activities may need what it
        made.
        """
        for variable in needs:
            self._needed.setdefault(variable, state)
        for variable in makes:
            self._made.setdefault(variable, state)
            if not is_done:
                self._being_made.setdefault(variable, state)

    def clash(self, state: int, needs: Iterable[str], makes: Iterable[str]) -> Objection | None:
        """The objection for the first variable that an activity may not need or change, if any."""
        changed = (
            (variable, reserved) for variable in makes for reserved in (self._made, self._needed)
        )
        for variable, reserved in (*changed, *((variable, self._being_made) for variable in needs)):
            if variable in reserved:
                return Objection(state, Reason.CONFLICT, variable, reserved[variable])
        return None


class Places:
    """The occupied places at each agent."""

    def __init__(self) -> None:
        self._taken: Counter[Agent] = Counter()

    def occupy(self, tasks: Iterable[Do]) -> None:
        """Occupy a place for each task, at each agent that it needs."""
        self._taken.update(agent for task in tasks for agent in task.agents)

    def full(self, tasks: Iterable[Do]) -> Agent | None:
        """The first agent that has too few free places for these tasks, if any."""
        wanted = Counter(agent for task in tasks for agent in task.agents)
        return next(
            (
                agent
                for agent, places in wanted.items()
                if self._taken[agent] + places > agent.tasks
            ),
            None,
        )
