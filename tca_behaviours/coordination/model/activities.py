"""What a state of a coordination machine does: tasks for agents, with what they need and what they
make so.
"""

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
"""Characters that a task has in the structure of its machine."""


def _are_facts(facts: Any) -> bool:
    return isinstance(facts, Mapping) and all(
        isinstance(name, str) and isinstance(value, str | bool | int | float)
        for name, value in facts.items()
    )


FACTS = ArgumentKind('values by name, such as {"arm": "home"}', _are_facts)


@dataclass(frozen=True)
class Agent:
    """A part of the robot that works on tasks: a base, an arm. It takes so many *tasks* at once;
    more than one only if its module weighs them by rank.
    """

    name: str
    tasks: int = 1

    def __post_init__(self) -> None:
        check("Agent", checks.LABEL, name=self.name)
        check(f"agent '{self.name}'", checks.COUNT, tasks=self.tasks)


class Do:
    """A task of an activity: a message, its data, and the agents that it needs."""

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
        """Message and data, in words."""

    def __repr__(self) -> str:
        return f"Do({self.text})"

    @property
    def has_progress(self) -> bool:
        """Whether it can report any."""
        return self.message.progress.kind is not type(None)


_DO = checks.instance_of("a Do", Do)
_COST = checks.number("a number, 0 or more", 0, float_info.max)
_COST_OR_FUNCTION = ArgumentKind(
    f"{_COST.words}, or a function", lambda cost: callable(cost) or _COST.fits(cost)
)


class Activity:
    """What a state does: its tasks run together, and it is done when all are.

    *needs*: facts that must hold when it starts and while it runs, until it makes them otherwise
        itself. *makes*: facts
    that hold when it is done; from its start until then they are unknown. *cost*: of doing it in
    vain, a number or a function of the Situation. *progress*: reads the progress of its tasks,
    where their messages report no plain number in [0, 1]. *undo*: tasks that restore what it has
    changed. *adapt*: makes the data of a task that runs ahead, at a share of its full speed and
    with a rank: its place in the preview list.
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
        """The cost of doing it in vain, as things are."""
        cost = self._cost(situation) if callable(self._cost) else self._cost
        check(self, _COST, cost=cost)
        return cost

    def data_at(self, share: float, rank: int) -> list[Any]:
        """The data of its tasks at a share of full speed; with rank 0, when its state is entered,
        their own. Raises what ``adapt`` raises, and BadData if its data do not fit.
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
        return any(task.has_progress for task in self.tasks)

    def progress(self, report: Any) -> float:
        """The progress in [0, 1] that a report of one of its tasks stands for."""
        value = self._progress(report) if self._progress is not None else report
        return min(1.0, max(0.0, float(value)))  # 0 for nan

    def _check(self) -> None:
        if not self.tasks:
            raise MisuseError(
                "an activity needs a task, such as Do(MOVE, data, agent); a state that only waits needs none"
            )
        for task in (*self.tasks, *self.undo):
            check("Activity", _DO, task=task)
        check(self, _COST_OR_FUNCTION, cost=self._cost)
        check(self, checks.FUNCTION_OR_NONE, progress=self._progress, adapt=self.adapt)
        for task in self.tasks:
            if self._progress is None and task.message.progress.kind not in (
                float,
                int,
                type(None),
            ):
                told = f"{task.message.title} reports {task.message.progress}"
                raise MisuseError(
                    f"{told}: give Activity(..., progress=...), a function that makes a number of it"
                )
