"""What activities take before their turn: variables, and places at agents. They are given to those
that come first.
"""

from collections import Counter
from collections.abc import Iterable

from tca_behaviours.coordination.model.activities import Agent, Do
from tca_wire.coordination import Objection, Reason


class Reservations:
    """The variables of activities that come first or run: later ones leave them alone."""

    def __init__(self) -> None:
        self._needed: dict[str, int] = {}  # by variable, the state whose activity needs it
        self._made: dict[str, int] = {}
        self._being_made: dict[str, int] = {}  # of these, what is not done

    def add(
        self, state: int, needs: Iterable[str], makes: Iterable[str], *, is_done: bool = False
    ) -> None:
        """Reserve the variables of an activity. One that is *done* keeps what it has made, for
        others to build on.
        """
        for variable in needs:
            self._needed.setdefault(variable, state)
        for variable in makes:
            self._made.setdefault(variable, state)
            if not is_done:
                self._being_made.setdefault(variable, state)

    def clash(self, state: int, needs: Iterable[str], makes: Iterable[str]) -> Objection | None:
        """The first variable that stands against the activity of a state, if any."""
        kept = (
            (variable, reserved) for variable in makes for reserved in (self._made, self._needed)
        )
        for variable, reserved in (*kept, *((variable, self._being_made) for variable in needs)):
            if variable in reserved:
                return Objection(state, Reason.CONFLICT, variable, reserved[variable])
        return None


class Places:
    """The places that are taken at each agent."""

    def __init__(self) -> None:
        self._taken: Counter[Agent] = Counter()

    def take(self, tasks: Iterable[Do]) -> None:
        """A place for each task, at each agent that it needs."""
        self._taken.update(agent for task in tasks for agent in task.agents)

    def full(self, tasks: Iterable[Do]) -> Agent | None:
        """The first agent that has too few places left for these tasks, if any."""
        wanted = Counter(agent for task in tasks for agent in task.agents)
        return next(
            (
                agent
                for agent, places in wanted.items()
                if self._taken[agent] + places > agent.tasks
            ),
            None,
        )
