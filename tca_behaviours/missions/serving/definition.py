"""Task definitions: the classes of a robot's tasks, and the message that the server offers for
each.
"""

import inspect
from typing import Any, Generic, Protocol, TypeVar, get_args, get_origin

import msgspec

from tca_behaviours.missions.outcomes import MISSION_TASK_FAILED, Status, TaskEnd, TaskStatus
from tca_behaviours.missions.serving.environment import Environment
from tca_behaviours.missions.serving.parameters import TaskFormat, fields_of, help_of, parameter
from tca_module import Command, FailureRaised, MisuseError, Task
from tca_module.checks import check_names

E = TypeVar("E", bound=Environment)


class RunInterface(Protocol):
    """The parts of a run that its task calls."""

    def publish(self) -> None:
        """Publish the task's new text."""

    def sleep(self, seconds: float) -> None:
        """Sleep, and answer updates and kills of the run in the meantime."""


class ServedTask(Generic[E]):
    """The base of PeriodicTask and OnceTask.

    Its annotated attributes are the task's parameters, unless their names begin with "_".
    """

    env: E
    """The environment that all tasks of the server share."""
    task: Task
    """The run as a task of the tree. Use it to send messages."""
    task_timeout: float = parameter(
        0.0, "The most seconds that it may run after initialise(); 0: no limit", minimum=0
    )
    foreground: bool = parameter(True, "Whether it replaces the task in the foreground", fixed=True)

    status_text = ""
    _run: RunInterface

    def initialise(self) -> None:
        """Prepare the run; this may take long. If it raises, neither ``iterate`` nor ``terminate``
        is called.
        """

    def iterate(self) -> Status | None:
        """Do the work. An exception ends the run.

        Returns:
            The status. None means completed.
        """
        raise NotImplementedError

    def terminate(self) -> None:
        """Leave the robot safe. Called once, however the run ends. A kill of the run does not end
        waits in this method.
        """

    def report(self, text: str) -> None:
        """Publish a text as the run's status: what it is doing, or why it failed.

        Observers get at most 5 texts a second. The newest text is also part of the run's end.

        Args:
            text: the text.
        """
        self.status_text = text
        self._run.publish()

    def failed(self, text: str) -> FailureRaised:
        """Make a failure of this run. Raise it: ``raise self.failed("no pose yet")``.

        Args:
            text: the reason.

        Returns:
            The failure.
        """
        return MISSION_TASK_FAILED(text=text)

    def sleep(self, seconds: float) -> None:
        """Sleep, and let other tasks use the environment in the meantime.

        Args:
            seconds: how long to sleep.

        Raises:
            TaskKilled, Stopped: the run must end. Let it through: ``terminate`` is called next.
        """
        self._run.sleep(seconds)


class PeriodicTask(ServedTask[E]):
    """A task whose ``iterate`` is called at a constant rate, until it returns COMPLETED.

    *E* is the class of the environment. Attributes that every task has: ``env``, the environment;
    ``task``, the run as a task of the tree, to send messages with. Parameters that every periodic
    task has: ``task_period``, ``task_timeout`` (both in seconds) and ``foreground``.

    Example::

        class Drive(PeriodicTask[Cart]):
            '''Drive to a place.'''

            goal: float = parameter(0.0, "Where to, in metres", minimum=0, maximum=10)

            def iterate(self) -> Status:
                self.env.place += max(-0.1, min(0.1, self.goal - self.env.place))
                return Status.COMPLETED if self.env.place == self.goal else Status.RUNNING
    """

    task_period: float = parameter(
        description="The seconds from one iteration to the next", minimum=0.001
    )

    def iterate(self) -> Status:
        """Do one step, in much less than a period.

        Returns:
            RUNNING, or COMPLETED at the goal.
        """
        raise NotImplementedError


class OnceTask(ServedTask[E]):
    """A task whose ``iterate`` is called once and takes the time it needs. The task then is
    completed.

    It has the attributes and parameters of a PeriodicTask, except ``task_period``. Its ``iterate``
    does not hold ``env.lock``: take the lock where you use the environment.
    """


COMMON = ("task_timeout", "foreground", "task_period")
"""The parameters that every task has; ``task_period`` only if it is periodic."""


class Idle(PeriodicTask[Environment]):
    """Do nothing, for ever."""

    def iterate(self) -> Status:
        """Continue to do nothing.

        Returns:
            RUNNING.
        """
        return Status.RUNNING


class Definition:
    """A task as its server offers it: a command with the task's parameters.

    Raises BadFormat if the class can't be a command.
    """

    def __init__(
        self, task: type[ServedTask[Any]], server: str, rate: float, *, is_idle: bool
    ) -> None:
        self.task = task
        self.name = task.__name__
        self.is_periodic = issubclass(task, PeriodicTask)
        base = PeriodicTask if self.is_periodic else OnceTask
        fields = fields_of(task, base, COMMON, {"task_period": 1 / rate})
        marker = {
            "server": server,
            "task": self.name,
            "help": help_of(task),
            "periodic": self.is_periodic,
            **({"idle": True} if is_idle else {}),
            "parameters": sorted(fields, key=lambda name: name in COMMON),
        }
        self.format = TaskFormat(task, fields, marker)
        self.message: Command[Any, TaskEnd] = Command(
            f"{server}.{self.name}", self.format, result=TaskEnd, progress=TaskStatus
        )

    def parameters(self, **given: Any) -> Any:
        """Return the data of the command. A parameter that is not given gets its default."""
        return self.format.kind(**given)

    def create(
        self, environment: Environment, task: Task, parameters: msgspec.Struct
    ) -> ServedTask[Any]:
        """Create the task object of one run."""
        served = self.task()
        served.env, served.task = environment, task
        for name, value in (self.format.defaults() | self.format.given_in(parameters)).items():
            setattr(served, name, value)
        return served

    def reason_to_reject(self, served: ServedTask[Any], parameters: msgspec.Struct) -> str:
        """Return why a running task can't be given these parameters; "" if it can."""
        for name, value in self.format.given_in(parameters).items():
            if self.format.fields[name].is_fixed and value != getattr(served, name):
                return f"parameter '{name}' can't be changed while the task runs"
        return ""

    def change(self, served: ServedTask[Any], parameters: msgspec.Struct) -> Any:
        """Give a running task new values of the given parameters. Returns all its parameters."""
        for name, value in self.format.given_in(parameters).items():
            setattr(served, name, value)
        return self.parameters(**{name: getattr(served, name) for name in self.format.fields})


def check_task(task: object) -> type[ServedTask[Any]]:
    """Return *task* if it is a class that can be a task. Raises MisuseError."""
    if not (isinstance(task, type) and issubclass(task, ServedTask)):
        raise MisuseError(
            f"{task!r:.60} is not a task: give a class that inherits from PeriodicTask or OnceTask"
        )
    if not issubclass(task, PeriodicTask | OnceTask):
        raise MisuseError(f"task {task.__name__} must inherit from PeriodicTask or OnceTask")
    if task.iterate in (PeriodicTask.iterate, ServedTask.iterate):
        raise MisuseError(f"task {task.__name__} has no iterate(): define it")
    check_names(task, ("initialise", "iterate", "terminate"))
    if inspect.iscoroutinefunction(task.iterate):
        raise MisuseError(
            f"task {task.__name__}: iterate() can't be 'async def': it runs in a thread of its own"
        )
    try:
        inspect.signature(task).bind()
    except TypeError:
        raise MisuseError(
            f"task {task.__name__}: its __init__ needs arguments: prepare in initialise() instead"
        ) from None
    return task


def environment_of(task: type) -> type:
    """Return the class of the environment that a task needs: *E* of its ``PeriodicTask[E]``."""
    for cls in task.__mro__:
        for base in vars(cls).get("__orig_bases__", ()):
            origin, arguments = get_origin(base), get_args(base)
            is_task = isinstance(origin, type) and issubclass(origin, ServedTask)
            if is_task and isinstance(arguments[0], type):
                return arguments[0]
    return Environment
