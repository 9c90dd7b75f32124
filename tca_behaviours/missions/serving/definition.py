"""Task definitions: the classes that a robot's author writes, and what the server makes of each."""

import inspect
from typing import Any, Generic, Protocol, TypeVar, get_args, get_origin

import msgspec

from tca_behaviours.missions.outcomes import MISSION_TASK_FAILED, Status, TaskEnd, TaskStatus
from tca_behaviours.missions.serving.environment import Environment
from tca_behaviours.missions.serving.parameters import TaskFormat, fields_of, help_of, parameter
from tca_module import Command, FailureRaised, MisuseError, Task

E = TypeVar("E", bound=Environment)


class RunInterface(Protocol):
    """The run that a task is in."""

    def tell(self) -> None:
        """The text of the task has changed."""

    def sleep(self, seconds: float) -> None:
        """Let time pass, and hear meanwhile what is wanted of the run."""


class ServedTask(Generic[E]):
    """The base of PeriodicTask and OnceTask. Its annotated attributes are parameters, unless they
    begin with "_".
    """

    env: E
    """The environment that all tasks of the server share."""
    task: Task
    """The run as a task of the tree: to send messages with."""
    task_timeout: float = parameter(
        0.0, "The most seconds that it may run once initialised; 0: any", minimum=0
    )
    foreground: bool = parameter(
        True, "Whether it takes the place of the task in the foreground", fixed=True
    )

    status_text = ""
    _run: RunInterface

    def initialise(self) -> None:
        """Prepare the run; it may take long. An error means that it could not: then nothing else is
        called.
        """

    def iterate(self) -> Status | None:
        """Do the work; returns the status. Errors and failures end the run."""
        raise NotImplementedError

    def terminate(self) -> None:
        """Leave the robot safe. Called once, however the run ends; no kill cuts its waits short."""

    def report(self, text: str) -> None:
        """Say what is going on, or why something failed: the text of the status."""
        self.status_text = text
        self._run.tell()

    def failed(self, text: str) -> FailureRaised:
        """The failure of this run, to be raised: ``raise self.failed("no pose yet")``."""
        return MISSION_TASK_FAILED(text=text)

    def sleep(self, seconds: float) -> None:
        """Let so many seconds pass. Raises TaskKilled or Stopped when the run is to end, after
        which comes ``terminate``.
        """
        self._run.sleep(seconds)


class PeriodicTask(ServedTask[E]):
    """A task whose ``iterate`` is called at a constant rate, until it returns COMPLETED."""

    task_period: float = parameter(
        description="The seconds from one iteration to the next", minimum=0.001
    )

    def iterate(self) -> Status:
        """Do one step, in much less than a period: returns RUNNING, or COMPLETED at the goal."""
        raise NotImplementedError


class OnceTask(ServedTask[E]):
    """A task whose ``iterate`` is called once, and takes the time it needs. When it returns, the
    task is completed.
    """


COMMON = ("task_timeout", "foreground", "task_period")
"""The parameters that every task has; the last one only if it is periodic."""


class Idle(PeriodicTask[Environment]):
    """Do nothing, for ever."""

    def iterate(self) -> Status:
        """Go on."""
        return Status.RUNNING


class Definition:
    """A task as its server offers it: a command with the task's parameters. Raises BadFormat if it
    can't be one.
    """

    def __init__(self, task: type[ServedTask[Any]], server: str, rate: float) -> None:
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
            "parameters": sorted(fields, key=lambda name: name in COMMON),
        }
        self.format = TaskFormat(task, fields, marker)
        self.message: Command[Any, TaskEnd] = Command(
            f"{server}.{self.name}", self.format, result=TaskEnd, progress=TaskStatus
        )

    def parameters(self, **given: Any) -> Any:
        """The data of the command: what is not given is left to its default."""
        return self.format.kind(**given)

    def create(
        self, environment: Environment, task: Task, parameters: msgspec.Struct
    ) -> ServedTask[Any]:
        """The task of one run."""
        made = self.task()
        made.env, made.task = environment, task
        for name, value in (self.format.defaults() | self.format.given_in(parameters)).items():
            setattr(made, name, value)
        return made

    def why_fixed(self, served: ServedTask[Any], parameters: msgspec.Struct) -> str:
        """The reason why a task that runs can't be given these parameters; "" if it can."""
        changed = [
            name
            for name, value in self.format.given_in(parameters).items()
            if value != getattr(served, name)
        ]
        fixed = [name for name in changed if self.format.fields[name].is_fixed]
        return f"parameter '{fixed[0]}' can't be changed while the task runs" if fixed else ""

    def change(self, served: ServedTask[Any], parameters: msgspec.Struct) -> Any:
        """Give a task that runs new values of the parameters that were given; all that it has
        now.
        """
        for name, value in self.format.given_in(parameters).items():
            setattr(served, name, value)
        return self.parameters(**{name: getattr(served, name) for name in self.format.fields})


def check_task(task: object) -> type[ServedTask[Any]]:
    """A class that can be a task. Raises MisuseError."""
    if not (isinstance(task, type) and issubclass(task, ServedTask)):
        raise MisuseError(
            f"{task!r:.60} is no task: give a class that inherits from PeriodicTask or OnceTask"
        )
    if not issubclass(task, PeriodicTask | OnceTask):
        raise MisuseError(f"task {task.__name__} must inherit from PeriodicTask or OnceTask")
    if task.iterate in (PeriodicTask.iterate, ServedTask.iterate):
        raise MisuseError(f"task {task.__name__} has no iterate(): define it")
    if inspect.iscoroutinefunction(task.iterate):
        raise MisuseError(
            f"task {task.__name__}: iterate() can't be 'async def': it runs in a thread of its own"
        )
    try:
        inspect.signature(task).bind()
    except TypeError:
        raise MisuseError(
            f"task {task.__name__} needs arguments to be made: prepare in initialise() instead"
        ) from None
    return task


def environment_of(task: type) -> type:
    """The class of the environment that a task wants: *E* of its ``PeriodicTask[E]``."""
    for one in task.__mro__:
        for base in vars(one).get("__orig_bases__", ()):
            origin, wanted = get_origin(base), get_args(base)
            if (
                isinstance(origin, type)
                and issubclass(origin, ServedTask)
                and isinstance(wanted[0], type)
            ):
                return wanted[0]
    return Environment
