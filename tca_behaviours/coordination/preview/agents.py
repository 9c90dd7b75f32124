"""Places at agents, which are given to activities in the order in which these will come."""

from collections import Counter
from collections.abc import Iterable

from tca_behaviours.coordination.model.activities import Agent, Do


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
        return next((agent for agent, places in wanted.items() if self._taken[agent] + places > agent.tasks), None)
