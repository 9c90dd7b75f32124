"""Coordinator: a machine whose runs are tasks of a module."""

from contextlib import suppress
from threading import Lock
from typing import Any

from tca_behaviours.coordination.model.interpreter import Interpreter
from tca_behaviours.coordination.model.machine import Coordination
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.preview.branches import needed_later
from tca_behaviours.coordination.preview.decide import LookAhead
from tca_behaviours.coordination.preview.policy import Policy
from tca_behaviours.coordination.preview.walk import PreviewLimits
from tca_behaviours.coordination.running.failures import RecordedFailures
from tca_behaviours.coordination.running.messages import (
    COORDINATION_EVENT,
    CoordinationEnd,
    MachineEvent,
)
from tca_behaviours.coordination.running.run import CoordinationRun
from tca_module import Command, MisuseError, Module, Sender, Task, TcaError, Variable
from tca_module.checks import DURATION, check, check_known, instance_of
from tca_module.log import log_of
from tca_wire.charts import MachineChart
from tca_wire.coordination import CoordinationReport
from tca_wire.points import TaskId

_PATIENCE = 5.0
_MACHINE = instance_of("a Coordination", Coordination)
_POLICY_OR_NONE = instance_of("a Policy such as Discrete(0.5)", Policy).or_none(" for no preview")
_LIMITS_OR_NONE = instance_of("PreviewLimits(...)", PreviewLimits).or_none()


class Coordinator:
    """Runs a coordination machine, as a task of a module.

    It sends the tasks of the current activity. It also sends the tasks of likely later states,
    early. All these tasks hang below the coordinator's own task.

    Example::

        coordinator = Coordinator(deliver, policy=Discrete(threshold=0.5))
        module = Module("coordinator")
        coordinator.handle_in(module)
        with module.running():
            print(coordinator.run(module))
    """

    def __init__(
        self,
        machine: Coordination,
        *,
        policy: Policy | None = None,
        limits: PreviewLimits | None = None,
        patience: float = _PATIENCE,
    ) -> None:
        """Create a coordinator; ``handle_in`` gives it a module.

        Args:
            machine: the machine.
            policy: decides which activities start early; None: none does, there is no preview.
            limits: where a preview ends. Default: ``PreviewLimits()``.
            patience: seconds that a task may take to end after a request; then it is killed.
                Default: 5.
        """
        check("Coordinator", _MACHINE, machine=machine)
        check("Coordinator", _POLICY_OR_NONE, policy=policy)
        check("Coordinator", _LIMITS_OR_NONE, limits=limits)
        check("Coordinator", DURATION, patience=patience)
        self.machine = machine
        self.chart = machine.chart
        """The machine as data. These are also the data of the coordinator's command."""
        self.message = Command(
            f"coordinate {machine.name}",
            MachineChart,
            result=CoordinationEnd,
            progress=CoordinationReport,
        )
        """The command that runs the machine."""
        self._look_ahead = None
        if policy is not None:
            needed = needed_later(machine)
            self._look_ahead = LookAhead(
                policy, limits or PreviewLimits(), needed, Mistakes(self._warn)
            )
        self._patience = patience
        self._failures = RecordedFailures(self.message.name)
        self._interpreter: Interpreter | None = None
        """The interpreter of all runs, one run at a time. None if another program handles the
        runs.
        """
        self._module_name = ""
        """The name of the module that handles the runs."""
        self._run: CoordinationRun | None = None
        self._events_before_run: list[tuple[TaskId, str]] = []
        """Events that arrived before the handler of their run started, each with the run's
        task.
        """
        self._run_lock = Lock()

    def __repr__(self) -> str:
        return f"the coordinator of {self.machine!r}"

    def handle_in(self, module: Module) -> None:
        """Let a module run the machine, one run at a time.

        The module also watches the machine's variables. Call ``handle_in`` before the module runs.

        Args:
            module: the module; it can have only one coordinator.

        Raises:
            MisuseError: the module has a coordinator already.
        """
        inputs = f"inputs of {self.machine.name}"
        self._interpreter, self._module_name = self.machine.interpreter(), module.name
        try:
            module.handles(COORDINATION_EVENT, resource=inputs)(self._on_event)
        except MisuseError:
            raise MisuseError(
                f"module '{module.name}' has a coordinator already: "
                f"handle {self.machine!r} in another module"
            ) from None
        module.handles(self.message, resource=self.message.name, refuses=["update"])(
            self._coordinate
        )
        self._failures.handle_in(module, self.message, inputs)
        for variable in self.machine.variables:
            self._watch_variable(module, variable, inputs)

    def run(self, sender: Sender) -> CoordinationEnd:
        """Run the machine and wait for its end.

        If the wait is interrupted, the run is killed.

        Args:
            sender: the module, or a task. The run then hangs below that task.

        Returns:
            The final state, and counts of transitions and early work.

        Raises:
            TaskFailed: the run failed: an activity failed and its state has no arrow for "failed".
            TaskKilled: the run was killed.
        """
        sent = sender.command(self.message, self.chart, sequential=False)
        try:
            return sent.result()
        except BaseException:
            with suppress(TcaError):
                sent.kill("its sender does not wait any longer")
            raise

    def post(self, event: str) -> None:
        """Send an event to the machine. May be called in any thread of the machine's process.

        Nothing happens if no run is under way, or if the current state has no arrow for the event.

        Args:
            event: the name of the event.

        Raises:
            MisuseError: the machine has no arrow for such an event.
        """
        check_known(f"{self.machine!r} has no event", event, sorted(self.machine.events))
        if (run := self._run) is not None:
            run.enqueue_event(event)

    def _warn(self, text: str) -> None:
        log_of(self._module_name).warning("%s", text)

    # --- handlers ---------------------------------------------------------------------------------

    def _coordinate(self, task: Task, chart: MachineChart) -> CoordinationEnd:
        if chart != self.chart:
            raise task.rejected(
                f"{self.machine!r} has another structure here: restart the program that sends it"
            )
        assert self._interpreter is not None
        self._interpreter.restart(task.time())
        run = CoordinationRun(
            self.machine, self._interpreter, self._look_ahead, task, self._failures, self._patience
        )
        with self._run_lock:
            self._run = run
            for task_id, event in self._events_before_run:
                if task_id == task.id:
                    run.enqueue_event(event)
            self._events_before_run.clear()
        try:
            return run.run_to_end()
        finally:
            self._run = None

    def _on_event(self, task: Task, event: MachineEvent) -> None:
        # "done" and "failed" are not among the events: only the machine's own tasks cause them.
        if event.machine != self.machine.name or event.event not in self.machine.events:
            return
        assigned = self._assigned_task(task) if self._run is None else None
        with self._run_lock:
            if self._run is not None:
                self._run.enqueue_event(event.event)
            elif assigned is not None:
                self._events_before_run.append((assigned, event.event))

    def _assigned_task(self, task: Task) -> TaskId | None:
        """Return the task of a run that central has assigned to this module, if any. The run's
        handler is about to start.
        """
        for ref in task.tasks(self.message):
            info = ref.info()
            if info is not None and info.module == self._module_name:
                return info.id
        return None

    def _watch_variable(self, module: Module, variable: Variable[Any], resource: str) -> None:
        def on_value(_: Task, __: Any) -> None:
            if (run := self._run) is not None:
                run.note_change(variable)

        module.handles(variable, resource=resource)(on_value)
