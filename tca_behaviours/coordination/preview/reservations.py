"""Reservations of early activities: facts, and places at agents. Earlier activities get them
first.
"""

from collections import Counter
from collections.abc import Iterable

from tca_behaviours.coordination.model.activities import Agent, Do
from tca_wire.coordination import Objection, Reason


class Reservations:
    """The facts of activities that come first or run. Later activities must not change them."""

    def __init__(self) -> None:
        self._needed: dict[str, int] = {}  # by fact, the state whose activity needs it
        self._made: dict[str, int] = {}
        self._being_made: dict[str, int] = {}  # the same for activities that are not done

    def add(
        self, state: int, needs: Iterable[str], makes: Iterable[str], *, is_done: bool = False
    ) -> None:
        """Reserve the facts of an activity. Once the activity *is done*, later activities may need
        the facts that it has made.
        """
        for fact in needs:
            self._needed.setdefault(fact, state)
        for fact in makes:
            self._made.setdefault(fact, state)
            if not is_done:
                self._being_made.setdefault(fact, state)

    def objection_to(
        self, state: int, needs: Iterable[str], makes: Iterable[str]
    ) -> Objection | None:
        """Return the objection for the first fact that an activity may not change or need, if
        any.
        """
        pairs = [(fact, reserved) for fact in makes for reserved in (self._made, self._needed)]
        pairs += [(fact, self._being_made) for fact in needs]
        for fact, reserved in pairs:
            if fact in reserved:
                return Objection(state, Reason.CONFLICT, fact, reserved[fact])
        return None


class Places:
    """The occupied places at each agent."""

    def __init__(self) -> None:
        self._taken: Counter[Agent] = Counter()

    def occupy(self, tasks: Iterable[Do]) -> None:
        """Occupy a place for each task, at each agent that it needs."""
        self._taken.update(agent for task in tasks for agent in task.agents)

    def full_agent(self, tasks: Iterable[Do]) -> Agent | None:
        """Return the first agent that has too few free places for these tasks, if any."""
        for agent, places in Counter(agent for task in tasks for agent in task.agents).items():
            if self._taken[agent] + places > agent.tasks:
                return agent
        return None
