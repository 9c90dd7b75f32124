"""One run of a machine: it receives changes and events, and starts and stops activities.

The whole run is in the thread that handles the coordinator's task. The thread waits for the next
event. Then the machine advances as far as it can, and a new preview is computed.
"""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, NoReturn

from tca_behaviours.coordination.model.interpreter import Interpreter, TakenArrow
from tca_behaviours.coordination.model.machine import Coordination
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Situation
from tca_behaviours.coordination.model.states import DONE, FAILED
from tca_behaviours.coordination.preview.decide import Decision, LookAhead
from tca_behaviours.coordination.running.activities_at_work import ActivitiesAtWork
from tca_behaviours.coordination.running.failures import RecordedFailures
from tca_behaviours.coordination.running.messages import (
    ACTIVITY_STOPPED,
    NEEDS_NOT_MET,
    CoordinationEnd,
)
from tca_behaviours.coordination.running.work import StartedActivity
from tca_module import Task, TcaError, Variable
from tca_wire.coordination import CoordinationReport, Foreseen
from tca_wire.text.early_work import late_objections, why_not_early, why_stopped


class CoordinationRun:
    """A running machine, as a task."""

    def __init__(
        self,
        machine: Coordination,
        interpreter: Interpreter,
        look_ahead: LookAhead | None,
        task: Task,
        failures: RecordedFailures,
        patience: float,
    ) -> None:
        """*interpreter* is the machine's interpreter, in the first state of the machine."""
        self._machine = machine
        self._look_ahead = look_ahead
        self._task = task
        self._interpreter = interpreter
        self._inbox = deque[Callable[[], object]]()
        self._events = deque[str]()
        self._variables: dict[str, Any] = {}
        self._changed = set[Variable[Any]]()
        """The variables that have changed since they were read."""
        self._mistakes = look_ahead.mistakes if look_ahead is not None else Mistakes()
        self._at_work = ActivitiesAtWork(
            machine.facts, task, failures, patience, self._inbox.append, self._mistakes
        )
        self._unmet = ""
        """The unmet needs of the current activity; "" if it can start."""
        self._failed_since_event = set[int]()
        """The states whose activity could not start since the last event arrived.

        If the machine enters such a state again without a new event, the run fails. Otherwise the
        machine might never stop.
        """
        self._was_begun = False
        """Whether the run has tried to start the activity of the current state, if any. The
        activity may have to wait.
        """
        self._read_at_end_of: StartedActivity | None = None
        """The activity at whose end the variables were read last."""
        self._unreported: list[TakenArrow] = []
        """The transitions since the last report."""
        self._last_report: CoordinationReport | None = None
        self._transitions = 0

    # --- input ------------------------------------------------------------------------------------

    def enqueue_event(self, event: str) -> None:
        """Enqueue an event. Thread-safe."""
        self._enqueue(lambda: self._events.append(event))

    def note_change(self, variable: Variable[Any]) -> None:
        """Note a change of a variable. Thread-safe."""
        self._changed.add(variable)
        self._task.wake()

    def _read(self, *variables: Variable[Any]) -> None:
        """Read the newest values from central. A value that arrives here may be older than that."""
        for variable in variables:
            self._variables[variable.name] = self._task.get_variable(variable, None)

    def _enqueue(self, change: Callable[[], object]) -> None:
        self._inbox.append(change)
        self._task.wake()

    def run_to_end(self) -> CoordinationEnd:
        """Run the machine to its end. No task of the machine outlives this call."""
        try:
            self._read(*self._machine.variables)
            while not self._is_over():
                self._advance()
                self._wait()
        except BaseException:
            # Without central no task can be killed; central kills them when the module is lost.
            with suppress(TcaError):
                self._at_work.kill_all(f"{self._machine!r} has ended")
            raise
        label, work = self._interpreter.state.label, self._at_work
        return CoordinationEnd(label, self._transitions, work.kept, work.wasted)

    def _is_over(self) -> bool:
        return (
            self._interpreter.is_ended and self._last_report is not None and self._at_work.is_over
        )

    def _wait(self) -> None:
        """Wait for the next event, and process all that have arrived."""
        if not self._is_over():
            times = (self._at_work.next_kill_at, self._interpreter.timers.next)
            due = min((time for time in times if time is not None), default=None)
            timeout = None if due is None else max(0.0, due - self._task.time())
            running = self._at_work.running_tasks
            self._task.wait_until(lambda: bool(self._inbox or self._changed), timeout, on=running)
        self._failed_since_event.clear()
        while self._inbox:
            self._inbox.popleft()()
        while self._changed:
            self._read(self._changed.pop())
        self._at_work.kill_late()

    # --- transitions and activities ---------------------------------------------------------------

    def _advance(self) -> None:
        """Advance the machine as far as it can; then look ahead."""
        while True:
            while self._try_transition():
                pass
            decision = self._decide()
            for stop in decision.stops:
                self._at_work.drop(stop.state, why_stopped(self._machine.chart, stop))
            self._begin_current()
            if not (self._unmet or self._events):
                break
            self._report(decision)
        self._begin_early(decision)
        self._report(decision)

    def _decide(self) -> Decision:
        if self._look_ahead is None:
            return Decision([])
        situation = self._situation()
        state, is_new = self._interpreter.current, bool(self._unreported)
        present = self._at_work.present(state, situation, is_new=is_new)
        return self._look_ahead.decide(self._machine.automaton(situation, self._mistakes), present)

    def _situation(self) -> Situation:
        current = self._at_work.current
        return Situation(
            self._interpreter.state.label,
            self._at_work.plain_facts,
            self._variables,
            current.progress if current is not None else 0.0,
        )

    def _begin_current(self) -> None:
        """Start the activity of the current state, if it has one and that activity need not wait.

        If the machine has ended, undo wasted work.
        """
        if self._interpreter.is_ended:
            self._at_work.undo_next()
        activity = self._interpreter.state.activity
        if activity is not None and self._at_work.current is None:
            self._unmet = self._at_work.begin(self._interpreter.current, activity)
        self._was_begun = True

    def _begin_early(self, decision: Decision) -> None:
        """Start early work, and adapt the speed of running early work."""
        ranks = {foreseen.state: rank for rank, foreseen in enumerate(decision.preview, 1)}
        for state, rank in ranks.items():
            work, activity = self._at_work.early_work(state), self._machine.states[state].activity
            share = decision.shares.get(state, work.share if work is not None else 0.0)
            is_unchanged = work is not None and (share, rank) == (work.share, work.rank)
            if activity is None or not share or is_unchanged:
                continue
            consequence = "does not run early" if work is None else "keeps its speed"
            make_data = partial(activity.data_at, share, rank)
            data = self._mistakes.value_or(None, f"{activity!r} {consequence}", make_data)
            if data is None:
                continue
            if work is None:
                self._at_work.begin_early(state, activity, share, rank, data)
            else:
                work.share, work.rank, work.data = share, rank, data
        self._at_work.update_tasks()

    def _try_transition(self) -> bool:
        """Take one transition, if possible. Returns whether one was taken.

        A state is left only after its activity was started, or could not start.
        """
        if not self._was_begun:
            return False
        current = self._at_work.current
        if self._unmet:
            is_cycle = self._interpreter.current in self._failed_since_event
            self._failed_since_event.add(self._interpreter.current)
            return (not is_cycle and self._take_arrow(FAILED)) or self._raise_failure()
        if current is not None and current.failed_task is not None:
            return self._take_arrow(FAILED) or self._raise_failure()
        if current is not None and current.is_done:
            if current is not self._read_at_end_of:  # its handler may have set variables
                self._read_at_end_of = current
                self._read(*self._machine.variables)
            if self._take_arrow(DONE):
                return True
        while self._events:
            if self._take_arrow(self._events.popleft()):
                return True
        due = self._interpreter.timers.due(self._task.time())
        return due is not None and self._take_arrow(due.event)

    def _take_arrow(self, event: str) -> bool:
        taken = self._interpreter.take(event, self._situation(), self._task.time())
        if not taken:
            return False
        self._unmet = ""
        self._unreported += taken
        self._transitions += len(taken)
        self._at_work.leave(f"{self._machine!r} has left its state by '{taken[0].symbol}'")
        self._was_begun = self._at_work.enter(self._interpreter.current)
        return True

    def _raise_failure(self) -> NoReturn:
        """Fail the run: the current activity has failed, and the machine has no arrow for that."""
        label = self._interpreter.state.label
        if self._unmet:
            raise NEEDS_NOT_MET(text=f"'{label}' can't begin: {self._unmet}")
        assert self._at_work.current is not None
        failed = self._at_work.current.failed_task
        assert failed is not None
        if failed.failure is not None:
            raise failed.failure.error_of(failed.sent)
        raise ACTIVITY_STOPPED(text=f"'{label}': {failed.sent} was killed: {failed.killed}")

    # --- reports ----------------------------------------------------------------------------------

    def _report(self, decision: Decision) -> None:
        role_changes, last_report = self._at_work.role_changes(), self._last_report
        for arrow in self._unreported[:-1]:
            refused = last_report.refused if last_report is not None else []
            self._task.report(
                CoordinationReport(arrow.after, arrow.symbol, arrow.before, refused=refused)
            )
        no_arrow = TakenArrow(-1, "", -1)  # the defaults of a report
        last = self._unreported[-1] if self._unreported else no_arrow
        self._unreported.clear()
        current, refused = self._interpreter.current, decision.refused
        preview = [_rounded(foreseen) for foreseen in decision.preview]
        report = CoordinationReport(
            current, last.symbol, last.before, preview, role_changes, refused
        )
        if (
            last.symbol
            or role_changes
            or last_report is None
            or (last_report.preview, last_report.refused) != (preview, refused)
        ):
            self._task.report(report)
            self._last_report = report
        for objection in late_objections(last_report, report) if last_report is not None else ():
            why = why_not_early(self._machine.chart, objection)
            if why.remedy:
                self._mistakes.report(*why)


def _rounded(foreseen: Foreseen) -> Foreseen:
    """Round the probabilities, so that tiny changes cause no new report."""
    return Foreseen(foreseen.state, round(foreseen.likelihood, 3), round(foreseen.probability, 3))
