"""Mission: the tasks of a server as functions, in plain Python."""

import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, Self, TypeVar

from tca_behaviours.missions.client.catalogue import Catalogue
from tca_behaviours.missions.client.conditions import (
    ConditionIsCompleted,
    ConditionVerified,
    MissionCondition,
)
from tca_behaviours.missions.client.errors import BadParameter, MissionTaskFailed, NotOffered
from tca_behaviours.missions.client.interrupts import interrupt_held
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.offered_task import OfferedTask
from tca_behaviours.missions.client.running_task import RunningTask, given_parameters, running_tasks
from tca_behaviours.missions.client.step_file import TaskBegun
from tca_behaviours.missions.client.steps import Steps
from tca_behaviours.missions.client.stopping import LOOKS_EVERY, Stopping
from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import TaskEnd
from tca_module import CentralLost, Command, MisuseError, Refused, Task, TcaError, Timeout, checks
from tca_module.checks import check
from tca_module.link.opening import CentralAddress
from tca_module.sending.any_task import first_ended

P = ParamSpec("P")
T = TypeVar("T")
D = TypeVar("D")

_PATIENCE = 10.0  # seconds that a mission waits for its server
_ENDED = 10  # tasks that have ended, and are remembered
_UPDATED_WITHIN = 10.0  # seconds that a server may take to change parameters
_CHECKPOINT = checks.instance_of("the path of a file", str | Path).or_none()
_CONDITION = checks.instance_of("an object with a method is_verified()", MissionCondition)


class BaseMission:
    """What every mission can do, whatever tasks there are. The classes of stub files inherit from
    it.
    """

    SERVER = ""  #: the server, where nothing is said

    def __init__(
        self,
        server: str = "",
        *,
        name: str = "",
        central: CentralAddress = None,
        patience: float = _PATIENCE,
        under: Task | None = None,
        leave_running: bool = False,
        checkpoint: Path | str | None = None,
    ) -> None:
        """*server*: whose tasks they are; may be left out where there is only one. *name*: that of
        the mission, in the tree; by default the program's. *patience*: seconds to wait for the
        server. *under*: a task, in its handler, to which the mission's tasks belong.
        *leave_running*: the end of the mission, also a crash, ends none of its tasks. *checkpoint*:
        the file in which ``step`` notes what was done.
        """
        self.central = central  #: its address, as it was given
        self._patience = patience
        self._name = name or _name_of_program()
        self._goal = MissionGoal(
            self._name, server or self.SERVER, central, under, stays=leave_running
        )
        self._catalogue = Catalogue(server or self.SERVER, self._goal)
        check("Mission", _CHECKPOINT, checkpoint=checkpoint)
        self._checkpoint = Path(checkpoint) if checkpoint is not None else None
        self._stopping = Stopping(self._name)
        self._steps: Steps | None = None
        self._leave_running = leave_running
        self._is_open = False
        self._looked_at: dict[int, int] = {}  # after which changes each task was looked at
        self._running: dict[int, TaskHandle] = {}
        self.ended = deque[TaskHandle](maxlen=_ENDED)  #: the last of its tasks to end, oldest first
        self._conditions: list[MissionCondition] = []
        self._interruption: ConditionVerified | MissionTaskFailed | None = (
            None  # with it conditions end a wait
        )

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self.close(error)

    def open(self) -> Self:
        """Join central and find the server. Raises CentralLost, or NotOffered if the server does
        not come.
        """
        if self._is_open:
            raise MisuseError("this mission is open already")
        if self._checkpoint is not None:
            self._steps = Steps(self._checkpoint, self._name, self._sent_before, self._finish)
        self._is_open = True
        try:
            self._goal.open()
            self._catalogue.find_server(self._patience)
        except BaseException as error:
            self.close(error)
            raise
        return self

    def close(self, error: BaseException | None = None) -> None:
        """Stop what still runs, and leave; twice does no harm. With an *error* the mission counts
        as failed.
        """
        if not self._is_open:
            return
        self._is_open = False
        if isinstance(error, SystemExit) and not error.code:
            error = None
        try:
            if not (self._leave_running or isinstance(error, CentralLost)):
                with contextlib.suppress(TcaError):
                    self._stopping.end(list(self._running.values()), "the mission has ended")
        finally:
            if self._steps is not None:
                self._steps.close(is_finished=error is None)
            self._goal.close(error, waits=not self._stopping.hung)

    # --- what there is ----------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """Its name, as central knows it: with a number, if another mission of that name runs."""
        self._check_open()
        return self._goal.name

    @property
    def server(self) -> str:
        """The name of the server."""
        return self._catalogue.server

    def offered(self) -> dict[str, OfferedTask]:
        """The tasks that the server offers now, by name."""
        self._check_open()
        return self._catalogue.tasks

    def running_tasks(self) -> list[RunningTask]:
        """The tasks of the server that have not ended, whoever has started them, oldest first."""
        self._check_open()
        return running_tasks(self._goal.sender, self.server)

    def _task(self, name: str) -> OfferedTask:
        self._check_open()
        return self._catalogue.task(name)

    def _check_open(self) -> None:
        if not self._is_open:
            raise MisuseError(
                "the mission is not open: use it inside 'with Mission(...) as mission:'"
            )

    # --- starting ---------------------------------------------------------------------------------

    def check(self, name: str, /, **parameters: Any) -> None:
        """Raise what a call of the task with these parameters would raise at once: UnknownTask or
        BadParameter.
        """
        self._task(name).fitted(parameters)

    def start(self, name: str, /, **parameters: Any) -> TaskHandle:
        """Start a task by name, and don't wait for it, whether it runs in the foreground or in the
        background.
        """
        return self._start(self._task(name), parameters)

    def _start(self, task: OfferedTask, parameters: dict[str, Any]) -> TaskHandle:
        handle = self.start_command(
            self._catalogue.message(task), task.fitted(parameters), task.name
        )
        handle.parameters = parameters
        return handle

    def start_command(self, command: Command[D, TaskEnd], data: D, name: str) -> TaskHandle:
        """Start a command as a task of the mission called *name*, also one that is no task of its
        server.
        """
        self._check_open()
        self._goal.check()
        if self._conditions:
            for running in list(self._running.values()):
                running.end  # noqa: B018 - heard now, not when the new task has begun
            self._raise_verified()
        below = self._goal.below()
        with below.parallel():  # the tasks of a mission have no order but that of its program
            sent = below.execute_if_handled(command, data)
        if sent is None:
            raise NotOffered(
                f"nobody offers {command.name} any more: start its server, see 'tca messages'"
            )
        handle = TaskHandle(name, sent, self._forget)
        self._running[handle.id] = handle
        if self._steps is not None:
            self._steps.note_task(handle)
        return handle

    def run(self, name: str, /, **parameters: Any) -> Any:
        """Run a task by name: ``mission.run("GoTo", goal_x=1.0)`` is
        ``mission.GoTo(goal_x=1.0)``.
        """
        task, handle = self._task(name), None
        try:
            with interrupt_held():
                handle = self._start(task, parameters)
        except KeyboardInterrupt as interrupt:
            if handle is not None:
                self._stopping.stop_after(interrupt, [handle], "the mission was interrupted")
            raise
        if not parameters.get("foreground", task.runs_in_foreground):
            return handle
        return self.finish(handle)

    def finish(self, task: TaskHandle) -> TaskEnd:
        """Wait for the end of a task, and stop it if that is interrupted. Raises MissionTaskFailed
        if it did not complete.
        """
        self._finish(task)
        return task.result()

    def _finish(self, task: TaskHandle) -> None:
        """Wait for the end of a task in the foreground; one that is not waited for any more must
        not go on.
        """
        try:
            self._wait([task], None, in_foreground=[task])
        except CentralLost:
            raise  # it can't be told
        except BaseException as error:
            self._stopping.stop_after(error, [task], "the mission was interrupted")
            raise

    # --- waiting ----------------------------------------------------------------------------------

    def wait_for_task(self, task: TaskHandle, timeout: float | None = None) -> TaskEnd:
        """Wait until a task has ended; its end. Raises MissionTaskFailed if it did not complete,
        Timeout.
        """
        self.wait_for_any_task([task], timeout)
        return task.result()

    def wait_for_any_task(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> TaskHandle:
        """Wait until one of the tasks has ended; that one. Raises MissionTaskFailed if it did not
        complete, Timeout.
        """
        ended = self.first_ended(tasks, timeout)
        if not ended:
            names = ", ".join(map(str, tasks))
            raise Timeout(f"{names} did not end within {timeout:g} s", can_wait=True)
        ended[0].result()
        return ended[0]

    def wait_for_all_tasks(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> list[TaskEnd]:
        """Wait until all of the tasks have ended; their ends. Raises MissionTaskFailed as soon as
        one did not complete, Timeout.
        """
        until = None if timeout is None else time.monotonic() + timeout
        left = list(tasks)
        while left:
            ended = self.wait_for_any_task(
                left, None if until is None else max(0.0, until - time.monotonic())
            )
            left.remove(ended)
        return [task.result() for task in tasks]

    def first_ended(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> list[TaskHandle]:
        """Wait until at least one of the tasks has ended; those that have. [] after *timeout*
        seconds. It doesn't raise for a task that failed: see ``end`` of each.
        """
        self._check_open()
        check("the wait for tasks", checks.TIMEOUT, timeout=timeout)
        if not tasks:
            raise MisuseError("there is no task to wait for: give at least one")
        check_handles(*tasks)
        return self._wait(tasks, timeout)

    def _wait(
        self,
        tasks: Sequence[TaskHandle],
        timeout: float | None,
        *,
        in_foreground: Sequence[TaskHandle] = (),
    ) -> list[TaskHandle]:
        """Wait until one of the tasks has ended, or something ends the wait: a condition, the loss
        of the server, a kill of the mission.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while not (ended := [task for task in tasks if task.is_known_over]):
            self._raise_verified(in_foreground)
            left = None if until is None else until - time.monotonic()
            if left is not None and left <= 0:
                return [task for task in tasks if task.is_over]
            if not self._hear(tasks, LOOKS_EVERY if left is None else min(left, LOOKS_EVERY)):
                self._stopping.look(tasks)
        self._goal.check(ask=any(task.is_interrupted for task in ended))
        return ended

    def _hear(self, tasks: Sequence[TaskHandle], timeout: float) -> bool:
        """Wait until something has happened that may end a wait for *tasks*; False if nothing has
        in time.
        """
        awaited = {task.sent: task for task in [*tasks, *self._running.values()]}
        is_certain = not self._conditions and timeout >= LOOKS_EVERY
        ended = first_ended(
            list(awaited),
            timeout,
            lambda: self._is_verified() or self._lost(tasks),
            brief=not is_certain,
        )
        for sent in ended:
            awaited[sent].note_end()  # type: ignore[index]  # one of those
        for task in self._lost(tasks):
            if self._waits_in_vain(task):
                task.stop(f"nobody offers {task.sent.message} any more")
                raise NotOffered(
                    f"nobody offers {task.sent.message} any more, and {task} waited for it: start its server"
                )
        return bool(ended or self._interruption)

    def _lost(self, tasks: Iterable[TaskHandle]) -> list[TaskHandle]:
        """The tasks whose message nobody handles any more, as central has said just now."""
        changes, lost = self._goal.changes, self._goal.lost
        gone = (
            [task for task in tasks if task.sent.message in lost and not task.is_known_over]
            if lost
            else []
        )
        return [task for task in gone if self._looked_at.get(task.id) != changes]

    def _waits_in_vain(self, task: TaskHandle) -> bool:
        """Whether a task that nobody offers any more had not begun. Else it is about to fail: its
        server was lost.
        """
        self._looked_at[task.id] = self._goal.changes
        info = task.sent.info()
        return info is not None and not (info.module or info.failure)

    # --- changing ---------------------------------------------------------------------------------

    def update_task(self, task: TaskHandle, /, **parameters: Any) -> None:
        """Change parameters of a task that runs; those that are not named stay as they are. Raises
        BadParameter before anything is sent, and Rejected, with the reason, if the task goes on as
        it was or has ended.
        """
        check_handles(task)
        offered, info = self._task(task.name), task.sent.info()
        present = given_parameters(info) if info is not None else task.parameters
        required = {name: present[name] for name in offered.required if name in present}
        task.sent.update(offered.fitted({**required, **parameters}), timeout=_UPDATED_WITHIN)
        task.parameters = {**task.parameters, **parameters}

    # --- stopping ---------------------------------------------------------------------------------

    def stop_task(self, task: TaskHandle, why: str = "the mission has stopped it") -> None:
        """Stop a task, and wait until it has left things safe. One that has ended is left alone."""
        check_handles(task)
        self._stopping.stop([task], why)

    def stop_all_tasks(self, why: str = "the mission has stopped it") -> None:
        """Stop all tasks of this mission, and wait until they have left things safe."""
        self._stopping.stop(list(self._running.values()), why)

    def _forget(self, task: TaskHandle) -> None:
        self._looked_at.pop(task.id, None)
        self._stopping.forget(task)
        if self._running.pop(task.id, None) is not None:
            self.ended.append(task)

    # --- steps ------------------------------------------------------------------------------------

    def step(
        self, name: str, function: Callable[P, T], /, *args: P.args, **parameters: P.kwargs
    ) -> T:
        """Call *function*, unless the step *name* was completed by an earlier run of this program:
        then give its value.

        ::

            mission.step("to the corner", mission.GoTo, goal_x=1.0, goal_y=1.0)

        Values must be plain data. A step that was under way when the program died raises
        StepUncertain, unless it was one task that completed. The steps of a mission that has come
        to its end are forgotten.
        """
        return self._opened_steps().run(
            name, function, lambda: function(*args, **parameters), again=False
        )

    def repeatable_step(
        self, name: str, function: Callable[P, T], /, *args: P.args, **parameters: P.kwargs
    ) -> T:
        """As ``step``, but one that was under way when the program died is done again."""
        return self._opened_steps().run(
            name, function, lambda: function(*args, **parameters), again=True
        )

    def skip_step(self, name: str) -> None:
        """Take a step as completed, with the value None."""
        self._opened_steps().skip(name)

    def _opened_steps(self) -> Steps:
        self._check_open()
        if self._steps is None:
            raise MisuseError("steps need a file: Mission(..., checkpoint='patrol.steps')")
        return self._steps

    def _sent_before(self, task: TaskBegun) -> TaskHandle | None:
        """A task that an earlier run of the program has sent; None if central has forgotten it."""
        offered = self.offered().get(task.name)
        if offered is None:
            return None
        try:
            sent = self._goal.sender.sent_task(
                self._catalogue.message(offered), task.id, task.epoch
            )
            handle = TaskHandle(task.name, sent, self._forget)
            handle.end  # noqa: B018 - is it known?
        except (CentralLost, Refused):
            return None
        return handle

    # --- conditions -------------------------------------------------------------------------------

    def add_condition(self, condition: MissionCondition) -> None:
        """From now on *condition* interrupts whatever the mission waits for, with
        ConditionVerified. One whose task did not complete interrupts with MissionTaskFailed.
        """
        check("add_condition()", _CONDITION, condition=condition)
        self._conditions.append(condition)

    def clear_conditions(self) -> None:
        """No condition interrupts the mission any more. The tasks of those with ``stop_on_clear``
        are stopped; it waits until they have left things safe. Raises Timeout.
        """
        cleared = [
            one
            for one in self._conditions
            if isinstance(one, ConditionIsCompleted) and one.stop_on_clear
        ]
        self._conditions.clear()
        self._stopping.stop([one.task for one in cleared], "its condition was cleared")

    def _is_verified(self) -> bool:
        """Whether a condition ends the wait now: it is verified, or never will be, since its task
        has failed.
        """
        try:
            verified = [condition for condition in self._conditions if condition.is_verified()]
            self._interruption = ConditionVerified(verified) if verified else None
        except MissionTaskFailed as failed:
            self._interruption = failed
        return self._interruption is not None

    def _raise_verified(self, in_foreground: Sequence[TaskHandle] = ()) -> None:
        if self._interruption is None:
            self._is_verified()
        interruption, self._interruption = self._interruption, None
        if interruption is None:
            return
        for (
            task
        ) in in_foreground:  # it stops together with the tasks of the conditions, not after them
            task.stop("the mission was interrupted")
        self.clear_conditions()
        raise interruption


class Mission(BaseMission):
    """The tasks of a server as functions.

    ::

        with Mission("turtle") as mission:
            mission.GoTo(goal_x=1.0, goal_y=1.0)

    Each call runs its task to the end and returns its TaskEnd, or raises MissionTaskFailed; with
    ``foreground=False`` it returns a TaskHandle at once. What still runs at the end of the block is
    stopped, and so it is when the process dies. For one thread.
    """

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):
            raise AttributeError(name, name=name, obj=self)
        return self._function(self._task(name))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(self._catalogue.names if self._is_open else ())]

    def _function(self, task: OfferedTask) -> Callable[..., Any]:
        """The function that runs a task; it knows its name, help and parameters."""

        def function(*values: Any, **parameters: Any) -> Any:
            if values:
                names = ", ".join(f"{one.name}=..." for one in task.parameters[: len(values)])
                raise BadParameter(
                    f"{task.name}() takes its parameters by name: {task.name}({names})"
                )
            return self.run(task.name, **parameters)

        function.__name__ = function.__qualname__ = task.name
        function.__annotations__ = {"return": TaskEnd}
        function.task_of_mission = task.name  # type: ignore[attr-defined]  # steps look for it
        function.__doc__ = task.in_words
        function.__module__ = self.server
        function.__signature__ = task.signature  # type: ignore[attr-defined]  # inspect reads it
        return function


def _name_of_program() -> str:
    """The name of the script that runs."""
    return Path(sys.argv[0]).stem.strip("-") or "script"
