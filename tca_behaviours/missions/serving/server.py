"""TaskServer: offers the tasks of a robot, and runs them."""

import contextlib
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from sys import float_info
from typing import Any

import msgspec

from tca_behaviours.missions.outcomes import MISSION_TASK_FAILED, Status, TaskEnd
from tca_behaviours.missions.serving.definition import Definition, ServedTask
from tca_behaviours.missions.serving.environment import Environment
from tca_behaviours.missions.serving.finding import Finding
from tca_behaviours.missions.serving.foreground import Foreground
from tca_behaviours.missions.serving.run import TaskRun
from tca_module import Callback, Module, Stopped, Task
from tca_module.checks import check, instance_of, number, whole
from tca_module.link.opening import CentralAddress
from tca_module.log import log_of

_IDLE_AFTER = 0.2  # seconds without a task in the foreground after which the idle task runs: missions do one after another
_IDLE_AGAIN_AFTER = 5.0  # seconds, if it failed
_KEPT_FREE = 2  # of the tasks at a time: one in the foreground, and one that takes its place
_ENVIRONMENT = instance_of("an object of a class that inherits from Environment", Environment)
_RATE = number("more than 0 iterations a second", float_info.min)
_CAPACITY = whole(f"{_KEPT_FREE + 1} or more", _KEPT_FREE + 1)


class TaskServer:
    """Offers tasks to missions, as commands "<name>.<task>", and runs them.

    ::

        server = TaskServer("turtle", TurtleEnvironment(), folder=Path(__file__).parent / "tasks")
        server.run()

    Its tasks are those of *tasks*, of the Python files in *folder*, and of installed packages
    (entry points "tca.missions.tasks") that are made for the class of the *environment*. Periodic
    tasks run at *rate* iterations a second where nothing else is said. At most *capacity* tasks run
    at a time. When no task has the foreground, *idle* runs; where it completes, it does so once.
    """

    def __init__(
        self,
        name: str,
        environment: Environment,
        tasks: Iterable[type[ServedTask[Any]]] = (),
        *,
        folder: Path | str | None = None,
        idle: type[ServedTask[Any]] | None = None,
        rate: float = 10.0,
        capacity: int = 16,
        central: CentralAddress = None,
    ) -> None:
        self.module = Module(name, central, capacity=capacity)
        self.environment = environment
        self._log = log_of(name)
        check(f"server '{name}'", _ENVIRONMENT, environment=environment)
        check(f"server '{name}'", _RATE, rate=rate)
        check(f"server '{name}'", _CAPACITY, capacity=capacity)
        finding = Finding(name, environment, rate, self._log)
        finding.add_given([*tasks, *([idle] if idle is not None else [])])
        if folder is not None:
            finding.add_folder(Path(folder))
        finding.add_installed()
        self.definitions = finding.definitions
        self.runs: set[TaskRun] = set()  #: those that run now
        self._lock = threading.Lock()
        self._most_beside = capacity - _KEPT_FREE
        self._idle = self.definitions[idle.__name__] if idle is not None else None
        self._idle_timer: Callback | None = None
        self._foreground = Foreground(self._left, self._log)
        for definition in self.definitions.values():
            self._offer(definition)
        self.module.at_start(lambda _: self._be_idle_after(_IDLE_AFTER))
        environment.attach(self.module)

    def __repr__(self) -> str:
        return f"TaskServer({self.module.name!r})"

    def run(self) -> None:
        """Serve until Ctrl-C or SIGTERM, as ``Module.run`` does: running tasks terminate first."""
        with contextlib.closing(self.environment):
            self.module.run()

    @contextlib.contextmanager
    def running(self) -> Iterator["TaskServer"]:
        """Serve while the block lasts."""
        with contextlib.closing(self.environment), self.module.running():
            yield self

    def _offer(self, definition: Definition) -> None:
        def run(task: Task, parameters: Any) -> TaskEnd:
            return self._run(definition, task, parameters)

        run.__qualname__ = f"of task {definition.name}"  # the log names it
        self.module.handles(definition.message, takes=["update"])(run)

    def _run(self, definition: Definition, task: Task, parameters: msgspec.Struct) -> TaskEnd:
        served = definition.create(self.environment, task, parameters)
        if served.foreground and definition is self._idle and not self._foreground.is_empty:
            return TaskEnd(
                Status.COMPLETED | Status.TERMINATED, "something else has the foreground"
            )
        run = TaskRun(definition, served, self.module.after, self._log)
        self._add(run)
        try:
            with (
                self._foreground.taken(task, run.tell_wait)
                if served.foreground
                else contextlib.nullcontext()
            ):
                return run.carry_out()
        except Stopped as error:  # in the words of those who sent the task
            raise Stopped(f"server '{self.module.name}' has ended") from error
        finally:
            with self._lock:
                self.runs.discard(run)
            self._foreground.forget(task)

    def _add(self, run: TaskRun) -> None:
        """Let it run, unless so many run beside the foreground that none could take its place."""
        with self._lock:
            beside = sum(not one.served.foreground for one in self.runs)
            if not run.served.foreground and beside >= self._most_beside:
                text = f"{beside} tasks run in the background already: give the server a larger capacity="
                raise MISSION_TASK_FAILED(text=text)
            self.runs.add(run)

    # --- idle -------------------------------------------------------------------------------------

    def _left(self, task: Task, error: BaseException | None) -> None:
        """*task* was the last in the foreground: soon the idle task is, unless it was that and has
        completed.
        """
        was_idle = self._idle is not None and task.message == self._idle.message.name
        if error is not None or not was_idle:
            self._be_idle_after(_IDLE_AGAIN_AFTER if was_idle else _IDLE_AFTER)

    def _be_idle_after(self, seconds: float) -> None:
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        if not self.module.stopping:
            self._idle_timer = self.module.after(seconds, self._start_idle)

    def _start_idle(self, callback: Callback) -> None:
        if self._idle is not None and self._foreground.is_empty:
            callback.command(self._idle.message, self._idle.parameters(), sequential=False)
