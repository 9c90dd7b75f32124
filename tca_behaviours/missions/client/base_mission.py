"""The base class of missions: it starts, awaits, changes and stops tasks of a server."""

import contextlib
import sys
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, Self, TypeVar

from tca_behaviours.missions.client import dry_run
from tca_behaviours.missions.client.catalogue import Catalogue
from tca_behaviours.missions.client.interrupts import delay_interrupt, report_in_one_line
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.mission_tasks import MissionTasks
from tca_behaviours.missions.client.mission_waits import MissionWaits
from tca_behaviours.missions.client.offered_task import OfferedTask
from tca_behaviours.missions.client.running_task import RunningTask, given_parameters, running_tasks
from tca_behaviours.missions.client.step_file import TaskBegun
from tca_behaviours.missions.client.steps import Steps
from tca_behaviours.missions.client.task_handle import TaskHandle, check_handles
from tca_behaviours.missions.outcomes import TaskEnd
from tca_module import (
    CentralLost,
    Command,
    MisuseError,
    NotDeclared,
    Refused,
    Task,
    TaskRef,
    TcaError,
    checks,
)
from tca_module.checks import check
from tca_module.link.opening import CentralAddress

P = ParamSpec("P")
T = TypeVar("T")
D = TypeVar("D")

_PATIENCE = 10.0  # seconds that a mission waits for its server
_UPDATED_WITHIN = 10.0  # seconds that a server may take to change parameters
_CHECKPOINT = checks.instance_of("the path of a file", str | Path).or_none()
_TASK = checks.instance_of("the Task of a handler", Task).or_none()
_TASK_NAME = checks.instance_of("a text, such as 'Drive'", str)

_SHARED = ("", None, None, False, None)
"""The arguments that a mission beside another may not give, as they are without a value."""


class BaseMission(MissionWaits):
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
        beside: "BaseMission | None" = None,
    ) -> None:
        """Create a mission. It joins central when it is opened.

        Args:
            server: the server whose tasks the mission runs; may be left out if there is only one.
            name: the mission's name in the tree. Default: the name of the program.
            central: where central listens: one address, or several with commas, of which one
                central leads. Default: ``$TCA_CENTRAL``, else the default socket.
            patience: how many seconds to wait for the server. Default: 10.
            under: the task whose handler runs the mission; the mission's tasks stand below it.
                Default: None, a new goal.
            leave_running: whether the tasks outlive the mission or its crash. Default: False.
            checkpoint: the file in which ``step`` records completed steps. Default: None, no steps.
            beside: an open mission. This one gives it the tasks of another server: the two share
                name, goal, waits, conditions, steps and end. Default: None.

        Raises:
            MisuseError: an argument is wrong, or does not fit *beside*.
        """
        check("Mission", checks.TEXT, server=server)
        check("Mission", checks.PATIENCE, patience=patience)
        self._patience = patience
        self._leave_running = leave_running
        self._beside = beside
        check("Mission", _CHECKPOINT, checkpoint=checkpoint)
        self._checkpoint = Path(checkpoint) if checkpoint is not None else None
        self.central = central  #: its address, as it was given
        server = server or self.SERVER
        if beside is None:
            self._tasks = _new_tasks(name, server, central, under, leave_running)
        else:
            check("Mission", _MISSION, beside=beside)
            if (name, central, under, leave_running, checkpoint) != _SHARED:
                raise MisuseError(
                    "Mission(beside=...) shares name=, central=, under=, leave_running= and "
                    "checkpoint= with the mission beside it: leave them out"
                )
            self._tasks, self.central = beside._tasks, beside.central  # noqa: SLF001 - same class
        self._catalogue = Catalogue(server, self._tasks.goal)

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self.close(error)

    def open(self) -> Self:
        """Join central and find the server. A ``with`` block calls it.

        Returns:
            The mission.

        Raises:
            CentralLost: central can't be reached.
            NotOffered: the server did not appear within ``patience`` seconds.
            MisuseError: the mission is open already, or must name one of several servers.
        """
        if self._is_open:
            raise MisuseError("this mission is open already")
        if self._beside is not None:
            self._beside._check_open()  # noqa: SLF001 - the same class
        if self._checkpoint is not None and self._tasks.dry_run is None:
            self._tasks.steps = Steps(
                self._checkpoint, self._tasks.name, self._find_earlier_task, self._wait_or_stop
            )
        self._is_open = True
        try:
            if self._beside is None:
                self._tasks.goal.open()
            self._catalogue.find_server(self._patience)
        except BaseException as error:
            self.close(error)
            raise
        return self

    def close(self, error: BaseException | None = None) -> None:
        """Stop all running tasks and leave central. Closing again does nothing.

        A ``with`` block calls it. With an *error*, which ended the mission, the mission has failed.
        The end of a mission that was opened ``beside`` another stops nothing.

        Args:
            error: the error that ended the mission. Default: None.
        """
        if not self._is_open:
            return
        self._is_open = False
        if self._beside is not None:
            return
        tasks = self._tasks
        if isinstance(error, KeyboardInterrupt):
            report_in_one_line(f"mission '{tasks.name}' was ended by Ctrl-C")
        if isinstance(error, SystemExit) and not error.code:
            error = None
        try:
            if not (self._leave_running or isinstance(error, CentralLost)):
                with contextlib.suppress(TcaError):
                    running = list(tasks.running.values())
                    tasks.stopping.stop_at_end(running, "the mission has ended")
        finally:
            if tasks.steps is not None:
                tasks.steps.close(is_finished=error is None)
            tasks.goal.close(error, waits=not tasks.stopping.hung)
            if tasks.dry_run is not None and error is None:
                tasks.dry_run.report(tasks.name)

    # --- the server and its tasks -----------------------------------------------------------------

    @property
    def name(self) -> str:
        """The mission's name in central. It ends with a number if the name was in use already."""
        self._check_open()
        return self._tasks.goal.name

    @property
    def ended(self) -> deque[TaskHandle]:
        """The last 10 tasks of the mission that have ended, oldest first."""
        return self._tasks.ended

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
        return running_tasks(self._tasks.goal.sender, self.server)

    def find_task(self, task: RunningTask | int) -> TaskHandle:
        """Find a running task of the server, also one that another program has sent.

        Args:
            task: the task's number, as in the tree, or an entry of ``running_tasks()``.

        Returns:
            The handle of the task, to wait for it, to stop it, or for a condition.

        Raises:
            MisuseError: the server runs no such task.

        Example::

            charge = station.find_task(24)
            station.wait_for_task(charge)
        """
        self._check_open()
        number = task.id if isinstance(task, RunningTask) else task
        check("find_task()", checks.NUMBER, task=number)
        if (found := self._tasks.running.get(number)) is not None:
            return found
        ref = None
        with contextlib.suppress(Refused):  # central has never had a task of that number
            ref = self._tasks.goal.sender.task(number)
        if ref is None or not ref.message.startswith(f"{self.server}."):
            raise MisuseError(
                f"server '{self.server}' runs no task {number}: running_tasks() lists its tasks"
            )
        return self._handle_of(ref)

    def _handle_of(self, task: TaskRef) -> TaskHandle:
        """Return the handle of a task that another program may have sent."""
        offered = self._task(task.message.removeprefix(f"{self.server}."))
        sent = self._tasks.goal.sender.sent_task(self._catalogue.message(offered), task.id)
        return self._tasks.running.get(task.id) or TaskHandle(offered.name, sent, self._tasks)

    def _task(self, name: str) -> OfferedTask:
        self._check_open()
        check("the name of a task", _TASK_NAME, name=name)
        return self._catalogue.task(name)

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
        return self._tasks.start(command, data, name)

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
                self._tasks.stopping.stop_after(interrupt, [handle], "the mission was interrupted")
            raise
        if not parameters.get("foreground", task.runs_in_foreground):
            return handle
        return self.finish(handle)

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
        offered = self._task(task.name)
        if self._tasks.dry_run is not None:
            offered.validate({**task.parameters, **parameters})
            return
        info = task.sent.info()
        given = given_parameters(info) if info is not None else task.parameters
        # An update, too, must give the parameters that have no default.
        required = {name: given[name] for name in offered.required if name in given}
        task.sent.update(offered.validate({**required, **parameters}), timeout=_UPDATED_WITHIN)
        task.parameters = {**task.parameters, **parameters}

    # --- stopping ---------------------------------------------------------------------------------

    def stop_task(
        self, task: TaskHandle | RunningTask | int, why: str = "the mission has stopped it"
    ) -> None:
        """Stop a task, and wait until it has terminated. Does nothing if it has ended.

        Args:
            task: a task of this mission, or any other task of the server: its number, or an entry
                of ``running_tasks()``.
            why: the reason that tree and journal show.

        Raises:
            Timeout: the task did not end within 10 seconds.
            MisuseError: the server runs no task of that number.
        """
        found = self.find_task(task) if isinstance(task, RunningTask | int) else task
        check_handles(found, owner=self._tasks)
        self._stop([found], why)

    def stop_all_tasks(self, why: str = "the mission has stopped it") -> None:
        """Stop all tasks of this mission, and wait until they have terminated.

        Args:
            why: the reason that tree and journal show.

        Raises:
            Timeout: a task did not end within 10 seconds.
        """
        self._stop(list(self._tasks.running.values()), why)

    def idle(self, why: str = "a mission wants the server idle") -> None:
        """Stop all tasks of the server, also those of other missions, and wait until they have
        terminated. The server's idle task follows, if it has one.

        Args:
            why: the reason that tree and journal show.

        Raises:
            Timeout: a task did not end within 10 seconds.
        """
        self._check_open()
        busy = {task.message for task in self._catalogue.tasks.values() if not task.is_idle}
        living = [task for task in self._tasks.goal.sender.tasks() if task.message in busy]
        self._stop([self._handle_of(task) for task in living], why)

    def _stop(self, tasks: Sequence[TaskHandle], why: str) -> None:
        if self._tasks.dry_run is None:
            self._tasks.stopping.stop(tasks, why)

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
        return self._step(name, function, args, parameters, is_repeatable=False)

    def repeatable_step(
        self, name: str, function: Callable[P, T], /, *args: P.args, **parameters: P.kwargs
    ) -> T:
        """Do a step as ``step`` does, but repeat it if it was under way when the program died.

        Args:
            name: the step's name, unique in the mission.
            function: a task of the mission, or any function that returns plain data.
            args: its arguments.
            parameters: its keyword arguments.

        Returns:
            The value of the function.

        Raises:
            MisuseError: as for ``step``.
        """
        return self._step(name, function, args, parameters, is_repeatable=True)

    def _step(
        self,
        name: str,
        function: Callable[..., T],
        args: Sequence[Any],
        parameters: dict[str, Any],
        *,
        is_repeatable: bool,
    ) -> T:
        check("a step", checks.FUNCTION, function=function)
        if self._tasks.dry_run is not None:
            return function(*args, **parameters)
        return self._require_steps().run(
            name, function, lambda: function(*args, **parameters), is_repeatable=is_repeatable
        )

    def skip_step(self, name: str) -> None:
        """Mark a step as done, with the value None.

        Args:
            name: the step's name.

        Raises:
            MisuseError: as for ``step``.
        """
        if self._tasks.dry_run is None:
            self._require_steps().skip(name)

    def _require_steps(self) -> Steps:
        self._check_open()
        if self._tasks.steps is None:
            raise MisuseError("steps need a file: Mission(..., checkpoint='patrol.steps')")
        return self._tasks.steps

    def _find_earlier_task(self, task: TaskBegun) -> TaskHandle | None:
        """Find a task of an earlier run of the program; None if central has forgotten it."""
        sender = self._tasks.goal.sender
        try:
            command = sender.declared(task.message or f"{self.server}.{task.name}")
            handle = TaskHandle(
                task.name, sender.sent_task(command, task.id, task.epoch), self._tasks
            )
            handle.end  # noqa: B018 - raises if central does not know the task
        except (CentralLost, NotDeclared, Refused):
            return None
        return handle


def _new_tasks(
    name: str,
    server: str,
    central: CentralAddress,
    under: Task | None,
    leave_running: bool,
) -> MissionTasks:
    """Check the arguments of a mission that is beside no other, and create its tasks."""
    check("Mission", checks.TEXT, name=name)
    check("Mission", _TASK, under=under)
    check("Mission", checks.FLAG, leave_running=leave_running)
    name = name or _name_of_program()
    is_dry = dry_run.is_asked_for()
    # A dry run sends no goal either.
    goal = MissionGoal(name, server, central, under, leave_running=leave_running or is_dry)
    return MissionTasks(goal, name, dry_run.DryRun() if is_dry else None)


def _name_of_program() -> str:
    """Return the name of the running script."""
    return Path(sys.argv[0]).stem.strip("-") or "script"


_MISSION = checks.instance_of("an open mission", BaseMission)
