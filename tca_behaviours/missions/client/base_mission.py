"""The base class of missions: it starts, awaits, changes and stops tasks of a server."""

import contextlib
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, Self, TypeVar

from tca_behaviours.missions.client.catalogue import Catalogue
from tca_behaviours.missions.client.conditions import ActiveConditions, MissionCondition
from tca_behaviours.missions.client.errors import NotOffered
from tca_behaviours.missions.client.interrupts import delay_interrupt
from tca_behaviours.missions.client.lost_handlers import LostHandlers
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.offered_task import OfferedTask
from tca_behaviours.missions.client.running_task import RunningTask, given_parameters, running_tasks
from tca_behaviours.missions.client.step_file import TaskBegun
from tca_behaviours.missions.client.steps import Steps
from tca_behaviours.missions.client.stopping import CHECK_PERIOD, Stopping
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
_MOST_ENDED = 10  # the number of ended tasks that a mission remembers
_UPDATED_WITHIN = 10.0  # seconds that a server may take to change parameters
_CHECKPOINT = checks.instance_of("the path of a file", str | Path).or_none()
_CONDITION = checks.instance_of("an object with a method is_verified()", MissionCondition)


class BaseMission:
    """The part of a mission that does not depend on its tasks. Stub files inherit it."""

    SERVER = ""  #: the server if none is given

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
        """Create a mission. It joins central when it is opened.

        Args:
            server: the server whose tasks the mission runs; may be left out if there is only one.
            name: the mission's name in the tree. Default: the name of the program.
            central: where central listens. Default: ``$TCA_CENTRAL``, else the default socket.
            patience: how many seconds to wait for the server. Default: 10.
            under: the task whose handler runs the mission; the mission's tasks stand below it.
                Default: None, a new goal.
            leave_running: whether the tasks outlive the mission or its crash. Default: False.
            checkpoint: the file in which ``step`` records completed steps. Default: None, no steps.
        """
        self.central = central  #: its address, as it was given
        self._patience = patience
        self._name = name or _name_of_program()
        self._goal = MissionGoal(
            self._name, server or self.SERVER, central, under, leave_running=leave_running
        )
        self._catalogue = Catalogue(server or self.SERVER, self._goal)
        check("Mission", _CHECKPOINT, checkpoint=checkpoint)
        self._checkpoint = Path(checkpoint) if checkpoint is not None else None
        self._stopping = Stopping(self._name)
        self._steps: Steps | None = None
        self._leave_running = leave_running
        self._is_open = False
        self._lost_handlers = LostHandlers(self._goal)
        self._running: dict[int, TaskHandle] = {}
        self.ended = deque[TaskHandle](maxlen=_MOST_ENDED)  #: its last ended tasks, oldest first
        self._conditions = ActiveConditions()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self.close(error)

    def open(self) -> Self:
        """Join central and find the server. A ``with`` block calls it.

        Raises:
            CentralLost: central can't be reached.
            NotOffered: the server did not appear within ``patience`` seconds.
            MisuseError: the mission is open already, or must name one of several servers.
        """
        if self._is_open:
            raise MisuseError("this mission is open already")
        if self._checkpoint is not None:
            self._steps = Steps(
                self._checkpoint, self._name, self._find_earlier_task, self._wait_or_stop
            )
        self._is_open = True
        try:
            self._goal.open()
            self._catalogue.find_server(self._patience)
        except BaseException as error:
            self.close(error)
            raise
        return self

    def close(self, error: BaseException | None = None) -> None:
        """Stop all running tasks and leave central. Closing again does nothing.

        A ``with`` block calls it. With an *error*, which ended the mission, the mission has failed.
        """
        if not self._is_open:
            return
        self._is_open = False
        if isinstance(error, SystemExit) and not error.code:
            error = None
        try:
            if not (self._leave_running or isinstance(error, CentralLost)):
                with contextlib.suppress(TcaError):
                    self._stopping.stop_at_end(
                        list(self._running.values()), "the mission has ended"
                    )
        finally:
            if self._steps is not None:
                self._steps.close(is_finished=error is None)
            self._goal.close(error, waits=not self._stopping.hung)

    # --- the server and its tasks -----------------------------------------------------------------

    @property
    def name(self) -> str:
        """The mission's name in central. It ends with a number if the name was in use already."""
        self._check_open()
        return self._goal.name

    @property
    def server(self) -> str:
        """The name of the server."""
        return self._catalogue.server

    def offered(self) -> dict[str, OfferedTask]:
        """Return the tasks that the server offers now, by name."""
        self._check_open()
        return self._catalogue.tasks

    def running_tasks(self) -> list[RunningTask]:
        """Return the server's living tasks, oldest first: also those of other missions."""
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
        """Check a task's name and parameters, and start nothing.

        Args:
            name: the name of a task that the server offers.
            parameters: the task's parameters, by name.

        Raises:
            UnknownTask: the server offers no such task.
            BadParameter: a parameter is unknown, missing, out of range, or of a wrong type.
        """
        self._task(name).validate(parameters)

    def start(self, name: str, /, **parameters: Any) -> TaskHandle:
        """Start a task by name, in the foreground or in the background, and do not wait for it.

        Args:
            name: the name of a task that the server offers.
            parameters: the task's parameters, by name.

        Returns:
            The handle of the task, to wait for it or to stop it.

        Raises:
            UnknownTask, BadParameter: as for ``check``.
            NotOffered: the server has left.
            ConditionVerified: a condition was verified; nothing was started.

        Example::

            drive = mission.start("Drive", goal=6.0)
            mission.update_task(drive, goal=2.0)
            mission.wait_for_task(drive)
        """
        return self._start(self._task(name), parameters)

    def _start(self, task: OfferedTask, parameters: dict[str, Any]) -> TaskHandle:
        handle = self.start_command(
            self._catalogue.message(task), task.validate(parameters), task.name
        )
        handle.parameters = parameters
        return handle

    def start_command(self, command: Command[D, TaskEnd], data: D, name: str) -> TaskHandle:
        """Start a command, of the server or another one, as a task, and do not wait for it.

        Args:
            command: a command whose result is a TaskEnd.
            data: its data.
            name: the name of the task in the mission and in errors.

        Returns:
            The handle of the task, to wait for it or to stop it.

        Raises:
            NotOffered, ConditionVerified: as for ``start``.
        """
        self._check_open()
        self._goal.raise_if_killed()
        if self._conditions.are_given:
            for running in list(self._running.values()):
                running.end  # noqa: B018 - learn of its end now, before the new task begins
            self._raise_interruption()
        below = self._goal.below()
        with below.parallel():  # only the program orders the tasks of a mission
            sent = below.execute_if_handled(command, data)
        if sent is None:
            raise NotOffered(f"no server offers {command.name} any more: start its server")
        handle = TaskHandle(name, sent, self._on_task_end)
        self._running[handle.id] = handle
        if self._steps is not None:
            self._steps.record_task(handle)
        return handle

    def run(self, name: str, /, **parameters: Any) -> Any:
        """Run a task by name: ``mission.run("GoTo", goal_x=1.0)`` is ``mission.GoTo(goal_x=1.0)``.

        Args:
            name: the name of a task that the server offers.
            parameters: the task's parameters, by name.

        Returns:
            The TaskEnd of the completed task; at once the TaskHandle of a task in the background.

        Raises:
            MissionTaskFailed: the task did not complete.
            UnknownTask, BadParameter, NotOffered, ConditionVerified: as for ``start``.
        """
        task, handle = self._task(name), None
        try:
            with delay_interrupt():
                handle = self._start(task, parameters)
        except KeyboardInterrupt as interrupt:
            if handle is not None:
                self._stopping.stop_after(interrupt, [handle], "the mission was interrupted")
            raise
        if not parameters.get("foreground", task.runs_in_foreground):
            return handle
        return self.finish(handle)

    def finish(self, task: TaskHandle) -> TaskEnd:
        """Wait for the end of a task, and stop the task if the wait is interrupted.

        Args:
            task: a task of this mission.

        Returns:
            The TaskEnd of the completed task.

        Raises:
            MissionTaskFailed: the task did not complete.
            ConditionVerified: a condition was verified; the task has been stopped.
        """
        self._wait_or_stop(task)
        return task.result()

    def _wait_or_stop(self, task: TaskHandle) -> None:
        """Wait for the end of a foreground task, and stop it if the wait ends with an error."""
        try:
            self._wait([task], None, in_foreground=[task])
        except CentralLost:
            raise  # without central no task can be stopped
        except BaseException as error:
            self._stopping.stop_after(error, [task], "the mission was interrupted")
            raise

    # --- waiting ----------------------------------------------------------------------------------

    def wait_for_task(self, task: TaskHandle, timeout: float | None = None) -> TaskEnd:
        """Wait until a task has ended.

        Args:
            task: a task of this mission.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The TaskEnd of the completed task.

        Raises:
            MissionTaskFailed: the task did not complete.
            Timeout: the task did not end in time; it runs on.
            ConditionVerified: a condition was verified.
            TaskKilled: the mission was killed.
        """
        self.wait_for_any_task([task], timeout)
        return task.result()

    def wait_for_any_task(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> TaskHandle:
        """Wait until one of the tasks has ended.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The task that has ended.

        Raises:
            MissionTaskFailed, Timeout, ConditionVerified, TaskKilled: as for ``wait_for_task``.
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
        """Wait until all of the tasks have ended.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait for all of them. Default: None, no bound.

        Returns:
            The TaskEnd of each completed task, in the order of *tasks*.

        Raises:
            MissionTaskFailed: a task did not complete; raised as soon as the first one did not.
            Timeout, ConditionVerified, TaskKilled: as for ``wait_for_task``.
        """
        until = None if timeout is None else time.monotonic() + timeout
        remaining = list(tasks)
        while remaining:
            ended = self.wait_for_any_task(
                remaining, None if until is None else max(0.0, until - time.monotonic())
            )
            remaining.remove(ended)
        return [task.result() for task in tasks]

    def first_ended(
        self, tasks: Sequence[TaskHandle], timeout: float | None = None
    ) -> list[TaskHandle]:
        """Wait until at least one of the tasks has ended.

        Unlike ``wait_for_any_task`` it raises nothing for a task that failed: see its ``end``.

        Args:
            tasks: the tasks, one or more.
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            All of the tasks that have ended; [] if none did within *timeout* seconds.

        Raises:
            ConditionVerified, TaskKilled: as for ``wait_for_task``.
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
        """Wait until one of the tasks has ended, or an event ends the wait with an exception."""
        until = math.inf if timeout is None else time.monotonic() + timeout
        while not (ended := [task for task in tasks if task.is_known_over]):
            self._raise_interruption(in_foreground)
            remaining = until - time.monotonic()
            if remaining <= 0:
                return [task for task in tasks if task.is_over]
            if not self._wait_for_event(tasks, min(remaining, CHECK_PERIOD)):
                self._stopping.warn_of_hung(tasks)
        self._goal.raise_if_killed(ask=any(task.is_interrupted for task in ended))
        return ended

    def _wait_for_event(self, tasks: Sequence[TaskHandle], timeout: float) -> bool:
        """Wait for an event that may end a wait for *tasks*; False if there was none in time."""
        awaited = {task.sent: task for task in [*tasks, *self._running.values()]}
        ended = first_ended(
            list(awaited),
            timeout,
            lambda: self._conditions.check() or self._lost_handlers.newly_lost(tasks),
            # A condition or a short timeout will end this wait, so it is no deadlock.
            brief=self._conditions.are_given or timeout < CHECK_PERIOD,
        )
        for sent in ended:
            awaited[sent].record_end()  # type: ignore[index]
        self._lost_handlers.check(tasks)
        return bool(ended) or self._conditions.has_interruption

    # --- changing ---------------------------------------------------------------------------------

    def update_task(self, task: TaskHandle, /, **parameters: Any) -> None:
        """Change parameters of a running task. Parameters that are not named stay as they are.

        Args:
            task: a running task of this mission.
            parameters: the new values, by name.

        Raises:
            BadParameter: a parameter does not fit; nothing was sent.
            Rejected: the task runs on unchanged, or has ended; the text gives the reason.
            Timeout: the server did not answer within 10 seconds.
        """
        check_handles(task)
        offered, info = self._task(task.name), task.sent.info()
        given = given_parameters(info) if info is not None else task.parameters
        # An update, too, must give the parameters that have no default.
        required = {name: given[name] for name in offered.required if name in given}
        task.sent.update(offered.validate({**required, **parameters}), timeout=_UPDATED_WITHIN)
        task.parameters = {**task.parameters, **parameters}

    # --- stopping ---------------------------------------------------------------------------------

    def stop_task(self, task: TaskHandle, why: str = "the mission has stopped it") -> None:
        """Stop a task, and wait until it has terminated. Does nothing if it has ended.

        Args:
            task: a task of this mission.
            why: the reason that tree and journal show.

        Raises:
            Timeout: the task did not end within 10 seconds.
        """
        check_handles(task)
        self._stopping.stop([task], why)

    def stop_all_tasks(self, why: str = "the mission has stopped it") -> None:
        """Stop all tasks of this mission, and wait until they have terminated.

        Args:
            why: the reason that tree and journal show.

        Raises:
            Timeout: a task did not end within 10 seconds.
        """
        self._stopping.stop(list(self._running.values()), why)

    def _on_task_end(self, task: TaskHandle) -> None:
        self._lost_handlers.forget(task)
        self._stopping.forget(task)
        if self._running.pop(task.id, None) is not None:
            self.ended.append(task)

    # --- steps ------------------------------------------------------------------------------------

    def step(
        self, name: str, function: Callable[P, T], /, *args: P.args, **parameters: P.kwargs
    ) -> T:
        """Call *function*, unless an earlier run of this program has completed the step.

        The value of a completed step is returned without a call. When the mission ends without an
        error, its steps are forgotten.

        Args:
            name: the step's name, unique in the mission.
            function: a task of the mission, or any function that returns plain data.
            args: its arguments.
            parameters: its keyword arguments.

        Returns:
            The value of the function.

        Raises:
            StepUncertain: the program died during the step. If the step is one task that has
                completed, the step counts as done instead.
            MisuseError: the mission has no checkpoint, the name was used, or the value can't be
                stored.

        Example::

            mission.step("to the corner", mission.GoTo, goal_x=1.0, goal_y=1.0)
        """
        return self._require_steps().run(
            name, function, lambda: function(*args, **parameters), is_repeatable=False
        )

    def repeatable_step(
        self, name: str, function: Callable[P, T], /, *args: P.args, **parameters: P.kwargs
    ) -> T:
        """Do a step as ``step`` does, but repeat it if it was under way when the program died.

        Args, Returns, Raises: as for ``step``, without StepUncertain.
        """
        return self._require_steps().run(
            name, function, lambda: function(*args, **parameters), is_repeatable=True
        )

    def skip_step(self, name: str) -> None:
        """Mark a step as done, with the value None.

        Args:
            name: the step's name.

        Raises:
            MisuseError: as for ``step``.
        """
        self._require_steps().skip(name)

    def _require_steps(self) -> Steps:
        self._check_open()
        if self._steps is None:
            raise MisuseError("steps need a file: Mission(..., checkpoint='patrol.steps')")
        return self._steps

    def _find_earlier_task(self, task: TaskBegun) -> TaskHandle | None:
        """Find a task of an earlier run of the program; None if central has forgotten it."""
        offered = self.offered().get(task.name)
        if offered is None:
            return None
        try:
            sent = self._goal.sender.sent_task(
                self._catalogue.message(offered), task.id, task.epoch
            )
            handle = TaskHandle(task.name, sent, self._on_task_end)
            handle.end  # noqa: B018 - raises if central does not know the task
        except (CentralLost, Refused):
            return None
        return handle

    # --- conditions -------------------------------------------------------------------------------

    def add_condition(self, condition: MissionCondition) -> None:
        """Interrupt the mission's waits when a condition is verified.

        The wait then raises ConditionVerified, or MissionTaskFailed if the condition's task failed.

        Args:
            condition: a ConditionIsCompleted, or any object with a method ``is_verified()``.
        """
        check("add_condition()", _CONDITION, condition=condition)
        self._conditions.add(condition)

    def clear_conditions(self) -> None:
        """Remove all conditions. Stop their tasks, except with ``stop_on_clear=False``, and wait
        until these tasks end.

        Raises:
            Timeout: a task did not end within 10 seconds.
        """
        self._stopping.stop(self._conditions.clear(), "its condition was cleared")

    def _raise_interruption(self, in_foreground: Sequence[TaskHandle] = ()) -> None:
        """Raise the exception of a condition that interrupts the mission, if one does."""
        interruption = self._conditions.pop_interruption()
        if interruption is None:
            return
        for task in in_foreground:  # stop it now, not after the conditions' tasks
            task.stop("the mission was interrupted")
        self.clear_conditions()
        raise interruption


def _name_of_program() -> str:
    """Return the name of the running script."""
    return Path(sys.argv[0]).stem.strip("-") or "script"
