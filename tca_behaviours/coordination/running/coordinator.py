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
from tca_behaviours.coordination.running.failures import FailureNotes
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
_POLICY_OR_NONE = instance_of("a Policy such as Discrete(0.5)", Policy).or_none(" for no preview")


class Coordinator:
    """Runs a machine, with the tasks of its activities as commands under its own, and those of
    likely states ahead.

    ::

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
        """*policy*: when activities start ahead of their states; None: never, without a preview.
        *limits*: where a preview ends. *patience*: seconds after which a task is killed that was
        asked to end and has not.
        """
        check("Coordinator", instance_of("a Coordination", Coordination), machine=machine)
        check("Coordinator", _POLICY_OR_NONE, policy=policy)
        check(
            "Coordinator", instance_of("PreviewLimits(...)", PreviewLimits).or_none(), limits=limits
        )
        check("Coordinator", DURATION, patience=patience)
        self.machine = machine
        self.chart = machine.chart
        """The machine as data: those of its command."""
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
        self._failures = FailureNotes(self.message.name)
        self._interpreter: Interpreter | None = None
        """Of one run after the other; None if another program handles them."""
        self._home = ""
        """The module that handles them."""
        self._run: CoordinationRun | None = None
        self._unheard: list[tuple[TaskId, str]] = []
        """Events for a run, by its task, whose handler has not begun."""
        self._coming = Lock()

    def __repr__(self) -> str:
        return f"the coordinator of {self.machine!r}"

    def handle_in(self, module: Module) -> None:
        """Have a module run the machine, one run at a time. It watches the machine's variables,
        too; so a module has one coordinator.
        """
        news = f"news of {self.machine.name}"
        self._interpreter, self._home = self.machine.interpreter(), module.name
        declare = module.handles(COORDINATION_EVENT, resource=news)
        try:
            declare(self._note_event)
        except MisuseError:
            raise MisuseError(
                f"module '{module.name}' has a coordinator already: handle {self.machine!r} in another one"
            ) from None
        module.handles(self.message, resource=self.message.name, refuses=["update"])(
            self._coordinate
        )
        self._failures.handle_in(module, self.message, news)
        for variable in self.machine.variables:
            self._watch(module, variable, news)

    def run(self, sender: Sender) -> CoordinationEnd:
        """Run the machine, and wait for its end; a run that is not waited for any more is killed.
        Raises TaskFailed, TaskKilled.
        """
        run = sender.command(self.message, self.chart, sequential=False)
        try:
            return run.result()
        except BaseException:
            with suppress(TcaError):
                run.kill("it is not waited for any more")
            raise

    def post(self, event: str) -> None:
        """Tell the machine of an event; from any thread of the process in which it runs. A machine
        that does not run, or has no arrow for the event in its current state, does nothing.
        """
        check_known(f"{self.machine!r} has no event", event, sorted(self.machine.events))
        if (run := self._run) is not None:
            run.note_event(event)

    def _warn(self, text: str) -> None:
        log_of(self._home).warning("%s", text)

    # --- handlers ---------------------------------------------------------------------------------

    def _coordinate(self, task: Task, chart: MachineChart) -> CoordinationEnd:
        if chart != self.chart:
            raise task.rejected(
                f"{self.machine!r} has another structure here: start the program anew that sends it"
            )
        assert self._interpreter is not None
        self._interpreter.restart()
        run = CoordinationRun(
            self.machine, self._interpreter, self._look_ahead, task, self._failures, self._patience
        )
        with self._coming:
            self._run = run
            for of, event in self._unheard:
                if of == task.id:
                    run.note_event(event)
            self._unheard.clear()
        try:
            return run.until_end()
        finally:
            self._run = None

    def _note_event(self, task: Task, told: MachineEvent) -> None:
        if (
            told.machine != self.machine.name or told.event not in self.machine.events
        ):  # nobody else says "done"
            return
        coming = self._given_run(task) if self._run is None else None
        with self._coming:
            if self._run is not None:
                self._run.note_event(told.event)
            elif coming is not None:
                self._unheard.append((coming, told.event))

    def _given_run(self, task: Task) -> TaskId | None:
        """The run that central has given to this module, if there is one: its handler may be about
        to begin.
        """
        for run in task.tasks(self.message):
            info = run.info()
            if info is not None and info.module == self._home:
                return info.id
        return None

    def _watch(self, module: Module, variable: Variable[Any], resource: str) -> None:
        def note(_: Task, value: Any) -> None:
            if (run := self._run) is not None:
                run.note_variable(variable.name, value)

        module.handles(variable, resource=resource)(note)
