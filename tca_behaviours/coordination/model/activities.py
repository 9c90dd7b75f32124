"""Activities of a coordination machine: tasks for agents, with the facts they need and make."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from sys import float_info
from typing import Any

from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_module import Command, Goal, MisuseError, checks
from tca_module.checks import ArgumentKind, check
from tca_wire.text.bodies import data_text
from tca_wire.text.printable import shortened

_LONGEST = 200
"""The most characters of a task in the structure of its machine."""


def _are_facts(facts: Any) -> bool:
    return isinstance(facts, Mapping) and all(
        isinstance(name, str) and isinstance(value, str | bool | int | float)
        for name, value in facts.items()
    )


FACTS = ArgumentKind('values by name, such as {"arm": "home"}', _are_facts)


@dataclass(frozen=True)
class Agent:
    """A part of the robot that works on tasks, such as a base or an arm.

    Args:
        name: its name.
        tasks: how many tasks it takes at the same time. Default: 1. More than one makes sense only
            if the agent's module weighs its tasks by their rank.
    """

    name: str
    tasks: int = 1

    def __post_init__(self) -> None:
        check("Agent", checks.LABEL, name=self.name)
        check(f"agent '{self.name}'", checks.COUNT, tasks=self.tasks)


class Do:
    """A task of an activity.

    Args:
        message: the command or goal to send.
        data: its data.
        agents: the agents that the task needs.
    """

    def __init__(
        self, message: Command[Any, Any] | Goal[Any], data: Any = None, *agents: Agent
    ) -> None:
        check("Do", checks.instance_of("a command or a goal", Command | Goal), message=message)
        for agent in agents:
            check(f"Do({message.name!r}, ...)", checks.instance_of("an Agent", Agent), agent=agent)
        self.message = message
        self.data = data
        self.agents = agents
        self.text = shortened(
            f"{message.name} {data_text(message.encode_data(data))}".rstrip(), _LONGEST
        )
        """The message's name and the data as text."""

    def __repr__(self) -> str:
        return f"Do({self.text})"

    @property
    def has_progress(self) -> bool:
        """Whether the task can report progress."""
        return self.message.progress.kind is not type(None)


_DO = checks.instance_of("a Do", Do)
_COST = checks.number("a number, 0 or more", 0, float_info.max)
_COST_OR_FUNCTION = ArgumentKind(
    f"{_COST.words}, or a function", lambda cost: callable(cost) or _COST.fits(cost)
)


class Activity:
    """The tasks of a state. The tasks run together, and the activity is done when all of them are
    done.

    Args:
        tasks: the tasks, each a ``Do``; at least one.
        needs: facts that must hold when the activity starts. They must also hold while it runs,
            unless the activity changes them itself.
        makes: facts that hold when the activity is done. While the activity runs they are unknown.
        cost: the cost of the activity if it runs in vain: a number, or a function of the Situation.
            Default: 0.
        progress: converts a progress report of its tasks to a number in [0, 1]. Needed if their
            messages do not report such numbers.
        undo: tasks that restore the facts that the activity has changed.
        adapt: makes the data of a task that runs early. Its arguments are the task's data, a share
            of full speed, and a rank: the place in the preview list.

    Raises:
        MisuseError: the activity has no task, or an argument does not fit.

    Example::

        grasp = Activity(Do(GRASP, cup, ARM), needs={"arm": "home"}, makes={"arm": "cup"})
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
        check("Activity", FACTS, needs=needs or {}, makes=makes or {})
        self.tasks = tasks
        self.needs = dict(needs or {})
        self.makes = dict(makes or {})
        self.undo = tuple(undo) if isinstance(undo, Iterable) else (undo,)
        self.adapt = adapt
        self._cost = cost
        self._progress = progress
        self._check()

    def __repr__(self) -> str:
        return f"Activity({', '.join(task.text for task in self.tasks)})"

    def cost(self, situation: Situation) -> float:
        """Return the cost of the activity if it runs in vain in a situation.

        Args:
            situation: the situation.
        """
        cost = self._cost(situation) if callable(self._cost) else self._cost
        check(self, _COST, cost=cost)
        return cost

    def data_at(self, share: float, rank: int) -> list[Any]:
        """Return the data of the tasks at a share of full speed.

        Any error of ``adapt`` is raised, too.

        Args:
            share: the share of full speed, in [0, 1].
            rank: the place of the activity in the preview list. With 0, the state of the activity
                is the current one, and the data are as written.

        Returns:
            The data, one for each task.

        Raises:
            BadData: the data that ``adapt`` returns do not fit.
        """
        if rank == 0 or self.adapt is None:
            return [task.data for task in self.tasks]
        data = [self.adapt(task.data, share, rank) for task in self.tasks]
        for task, adapted in zip(self.tasks, data, strict=True):
            task.message.encode_data(adapted)
        return data

    @property
    def has_progress(self) -> bool:
        """Whether any of its tasks can report progress."""
        return any(task.has_progress for task in self.tasks)

    def progress(self, report: Any) -> float:
        """Convert a progress report of one of the tasks to a number.

        Args:
            report: the report.

        Returns:
            The progress, in [0, 1].
        """
        value = self._progress(report) if self._progress is not None else report
        return min(1.0, max(0.0, float(value)))  # NaN gives 0

    def _check(self) -> None:
        if not self.tasks:
            raise MisuseError(
                "an activity needs a task, such as Do(MOVE, data, agent); "
                "a state that only waits needs no activity"
            )
        for task in (*self.tasks, *self.undo):
            check("Activity", _DO, task=task)
        check(self, _COST_OR_FUNCTION, cost=self._cost)
        check(self, checks.FUNCTION_OR_NONE, progress=self._progress, adapt=self.adapt)
        for message in [task.message for task in self.tasks]:
            reports = message.progress.kind
            if self._progress is None and reports not in (float, int, type(None)):
                raise MisuseError(
                    f"{message.title} reports {message.progress}: "
                    "give Activity(..., progress=FUNCTION), which returns a number"
                )
