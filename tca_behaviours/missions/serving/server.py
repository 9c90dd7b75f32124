"""The server that offers a robot's tasks and runs them."""

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
from tca_behaviours.missions.serving.finding import TaskFinder
from tca_behaviours.missions.serving.foreground import Foreground
from tca_behaviours.missions.serving.run import TaskRun
from tca_module import Callback, CentralLost, Module, Stopped, Task
from tca_module.checks import block, check, instance_of, number, whole
from tca_module.link.opening import CentralAddress
from tca_module.log import log_of

# Seconds without a foreground task until the idle task runs. Between two tasks of a mission there
# is a short gap: the idle task must not run in it.
_IDLE_DELAY = 0.2
_IDLE_RETRY_DELAY = 5.0  # seconds until an idle task that failed runs again
_RESERVED = 2  # slots for the foreground: for its task, and for the next task
_ENVIRONMENT = instance_of("an object of a class that inherits from Environment", Environment)
_RATE = number("more than 0 iterations a second", float_info.min)
_TASKS = instance_of("a list of classes, such as [Drive]", Iterable)
_CAPACITY = whole(f"{_RESERVED + 1} or more", _RESERVED + 1)


class TaskServer:
    """Offers tasks to missions, as commands "<name>.<task>", and runs them.

    Tasks run in the foreground, one at a time, or in the background, any number at a time.

    Example::

        server = TaskServer("turtle", TurtleEnvironment(), folder="tasks")
        server.run()
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
        """Create a server; ``run`` or ``running`` starts it.

        Args:
            name: the name of the server and of its module.
            environment: the object that all tasks share.
            tasks: classes of tasks to offer.
            folder: a folder whose Python files define further tasks. Installed packages may add
                tasks, with entry points "tca.missions.tasks". Only tasks for the environment's
                class are added.
            idle: the task that runs while no other task has the foreground. After the idle task has
                completed, it runs again only after the next foreground task.
            rate: the iterations a second of a periodic task that sets no period. Default: 10.
            capacity: how many tasks may run at a time, 3 or more. Default: 16.
            central: where central listens: one address, or several with commas, of which one
                central leads. Default: ``$TCA_CENTRAL``, else the default socket.

        Raises:
            MisuseError, BadFormat: an argument is wrong, or one of *tasks* can't be offered.
        """
        self.module = Module(name, central, capacity=capacity)
        check(f"server '{name}'", _TASKS, tasks=tasks)
        self.environment = environment
        self._log = log_of(name)
        check(f"server '{name}'", _ENVIRONMENT, environment=environment)
        check(f"server '{name}'", _RATE, rate=rate)
        check(f"server '{name}'", _CAPACITY, capacity=capacity)
        finder = TaskFinder(name, environment, rate, self._log, idle)
        finder.add_given([*tasks, *([idle] if idle is not None else [])])
        if folder is not None:
            finder.add_folder(Path(folder))
        finder.add_installed()
        self.definitions = finder.definitions
        self.runs: set[TaskRun] = set()  #: the runs that have not ended
        self._lock = threading.Lock()
        self._max_background = capacity - _RESERVED
        self._idle = self.definitions[idle.__name__] if idle is not None else None
        self._idle_timer: Callback | None = None
        self._foreground = Foreground(self._on_foreground_empty, self._log)
        for definition in self.definitions.values():
            self._offer(definition)
        self.module.at_start(lambda _: self._schedule_idle(_IDLE_DELAY))
        environment.attach(self.module)

    def __repr__(self) -> str:
        return f"TaskServer({self.module.name!r})"

    def run(self) -> None:
        """Serve until Ctrl-C or SIGTERM, as ``Module.run`` does. Running tasks terminate first."""
        with contextlib.closing(self.environment):
            self.module.run()

    @block
    def running(self) -> Iterator["TaskServer"]:
        """Serve during a ``with`` block.

        Yields:
            The server.
        """
        with contextlib.closing(self.environment), self.module.running():
            yield self

    def _offer(self, definition: Definition) -> None:
        def run(task: Task, parameters: Any) -> TaskEnd:
            return self._run(definition, task, parameters)

        run.__qualname__ = f"of task {definition.name}"  # log lines show it
        self.module.handles(definition.message, takes=["update"])(run)

    def _run(self, definition: Definition, task: Task, parameters: msgspec.Struct) -> TaskEnd:
        served = definition.create(self.environment, task, parameters)
        if served.foreground and definition is self._idle and not self._foreground.is_empty:
            return TaskEnd(Status.COMPLETED | Status.TERMINATED, "another task has the foreground")
        run = TaskRun(definition, served, self.module.after, self._log)
        self._admit(run)
        try:
            with (
                self._foreground.held_by(task, run.publish_wait)
                if served.foreground
                else contextlib.nullcontext()
            ):
                return run.carry_out()
        except Stopped as error:  # name the server, which the mission's program knows
            why = f"server '{self.module.name}' has ended"
            if definition is self._idle:  # its end is no failure
                with contextlib.suppress(CentralLost):
                    task.kill(why)
            raise Stopped(why) from error
        finally:
            with self._lock:
                self.runs.discard(run)
            self._foreground.forget(task)

    def _admit(self, run: TaskRun) -> None:
        """Add a run. Raises a failure for a background run that would leave no slot for the
        foreground.
        """
        with self._lock:
            in_background = sum(not each.served.foreground for each in self.runs)
            if not run.served.foreground and in_background >= self._max_background:
                text = f"{in_background} tasks run in the background already"
                raise MISSION_TASK_FAILED(text=f"{text}: give the server a larger capacity=")
            self.runs.add(run)

    # --- idle -------------------------------------------------------------------------------------

    def _on_foreground_empty(self, task: Task, error: BaseException | None) -> None:
        """Start the idle task soon, unless *task* is an idle task that has completed.

        *task* was the last in the foreground, and *error* is its error, if any.
        """
        is_idle = self._idle is not None and task.message == self._idle.message.name
        if error is not None or not is_idle:
            self._schedule_idle(_IDLE_RETRY_DELAY if is_idle else _IDLE_DELAY)

    def _schedule_idle(self, seconds: float) -> None:
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        if not self.module.stopping:
            self._idle_timer = self.module.after(seconds, self._start_idle)

    def _start_idle(self, callback: Callback) -> None:
        if self._idle is not None and self._foreground.is_empty:
            callback.command(self._idle.message, self._idle.parameters(), sequential=False)
