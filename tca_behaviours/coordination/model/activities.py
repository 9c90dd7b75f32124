"""What a state of a coordination machine does: tasks for agents, with what they need and what they make so."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_module import Command, Goal, MisuseError
from tca_wire.text.bodies import data_text
from tca_wire.text.printable import shortened

_LONGEST = 200
"""Characters that a task has in the structure of its machine."""


@dataclass(frozen=True)
class Agent:
    """A part of the robot that works on tasks: a base, an arm. It takes so many *tasks* at once; more than one only if
    its module weighs them by rank.
    """

    name: str
    tasks: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise MisuseError(f"an agent needs a name, not {self.name!r:.60}")
        if type(self.tasks) is not int or self.tasks < 1:
            raise MisuseError(f"agent '{self.name}': tasks must be 1 or more, not {self.tasks!r:.60}")


class Do:
    """A task of an activity: a message, its data, and the agents that it needs."""

    def __init__(self, message: Command[Any, Any] | Goal[Any], data: Any = None, *agents: Agent) -> None:
        if not isinstance(message, Command | Goal):
            raise MisuseError(f"Do wants a command or a goal, not {message!r:.60}")
        if wrong := next((agent for agent in agents if not isinstance(agent, Agent)), None):
            raise MisuseError(f"Do({message.name!r}, ...): an agent must be an Agent, not {wrong!r:.60}")
        self.message = message
        self.data = data
        self.agents = agents
        self.text = shortened(f"{message.name} {data_text(message.encode_data(data))}".rstrip(), _LONGEST)
        """Message and data, in words."""

    def __repr__(self) -> str:
        return f"Do({self.text})"


class Activity:
    """What a state does: its tasks run together, and it is done when all are.

    *needs*: facts that must hold when it starts and while it runs, until it makes them otherwise itself. *makes*: facts
    that hold when it is done; from its start until then they are unknown. *cost*: of doing it in vain, a number or a
    function of the Situation. *progress*: reads the progress of its tasks, where their messages report no plain number
    in [0, 1]. *undo*: tasks that restore what it has changed. *adapt*: makes the data of a task that runs ahead, at a
    share of its full speed and with a rank: its place in the preview list.
    """

    def __init__(
        self,
        *tasks: Do,
        needs: Mapping[str, Fact] | None = None,
        makes: Mapping[str, Fact] | None = None,
        cost: float | Callable[[Situation], float] = 0.0,
        progress: Callable[[Any], float] | None = None,
        undo: Do | Iterable[Do] = (),
        adapt: Callable[[Any, float, int], Any] | None = None,
    ) -> None:
        self.tasks = tasks
        self.needs = checked_facts(needs or {}, "needs")
        self.makes = checked_facts(makes or {}, "makes")
        self.undo = tuple(undo) if isinstance(undo, Iterable) else (undo,)
        self.adapt = adapt
        self._cost = cost
        self._progress = progress
        self._check()

    def __repr__(self) -> str:
        return f"Activity({', '.join(task.text for task in self.tasks)})"

    def cost(self, situation: Situation) -> float:
        """The cost of doing it in vain, as things are."""
        cost = self._cost(situation) if callable(self._cost) else self._cost
        if not (isinstance(cost, int | float) and 0 <= cost < inf):
            raise MisuseError(f"{self!r}: its cost must be a number, 0 or more, not {cost!r:.60}")
        return cost

    def data_at(self, share: float, rank: int) -> list[Any]:
        """The data of its tasks at a share of full speed; with rank 0, when its state is entered, their own. Raises
        what ``adapt`` raises, and BadData if its data do not fit.
        """
        if rank == 0 or self.adapt is None:
            return [task.data for task in self.tasks]
        data = [self.adapt(task.data, share, rank) for task in self.tasks]
        for task, adapted in zip(self.tasks, data, strict=True):
            task.message.encode_data(adapted)
        return data

    @property
    def has_progress(self) -> bool:
        """Whether a task of it can report any."""
        return any(task.message.progress.kind is not type(None) for task in self.tasks)

    def progress(self, report: Any) -> float:
        """The progress in [0, 1] that a report of one of its tasks stands for."""
        value = self._progress(report) if self._progress is not None else report
        return min(1.0, max(0.0, float(value)))  # 0 for nan

    def _check(self) -> None:
        if not self.tasks:
            raise MisuseError(
                "an activity needs a task, such as Do(MOVE, data, agent); a state that only waits needs none"
            )
        if wrong := next((task for task in (*self.tasks, *self.undo) if not isinstance(task, Do)), None):
            raise MisuseError(f"a task of an activity must be a Do, not {wrong!r:.60}")
        if not callable(self._cost) and not (isinstance(self._cost, int | float) and 0 <= self._cost < inf):
            raise MisuseError(f"{self!r}: cost must be a number, 0 or more, or a function, not {self._cost!r:.60}")
        for name, function in (("progress", self._progress), ("adapt", self.adapt)):
            if function is not None and not callable(function):
                raise MisuseError(f"{self!r}: {name} must be a function, not {function!r:.60}")
        for task in self.tasks:
            if self._progress is None and task.message.progress.kind not in (float, int, type(None)):
                told = f"{task.message.title} reports {task.message.progress}"
                raise MisuseError(f"{told}: give Activity(..., progress=...), a function that makes a number of it")


def checked_facts(facts: Mapping[str, Fact], what: str) -> dict[str, Fact]:
    """A copy. Raises MisuseError if they are not values by name."""
    if not isinstance(facts, Mapping) or not all(isinstance(name, str) for name in facts):
        raise MisuseError(f'{what} must be values by name, such as {{"arm": "home"}}, not {facts!r:.60}')
    for name, value in facts.items():
        if not isinstance(value, str | bool | int | float):
            raise MisuseError(f"{what}: '{name}' must be a str, bool or number, not {value!r:.60}")
    return dict(facts)
