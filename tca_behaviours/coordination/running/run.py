"""One run of a machine: it receives changes and events, and starts and stops activities.

All of it runs in the thread that handles the coordinator's task. The thread waits for the next
event. Then the machine advances as far as it can, and a new preview is computed.
"""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

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
from tca_module import Task, TcaError
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
        """*interpreter* is that of the machine, in its first state."""
        self._machine = machine
        self._look_ahead = look_ahead
        self._task = task
        self._interpreter = interpreter
        self._inbox = deque[Callable[[], object]]()
        self._events = deque[str]()
        self._variables: dict[str, Any] = {}
        self._mistakes = look_ahead.mistakes if look_ahead is not None else Mistakes()
        self._work = ActivitiesAtWork(
            machine.facts, task, failures, patience, self._inbox.append, self._mistakes
        )
        self._unmet = ""
        """Why the current activity can't start; "" if it can."""
        self._failed_since_event = set[int]()
        """The states whose activity could not start, since the last event arrived.

        A second entry of one of them would be an endless cycle.
        """
        self._is_entered = False
        """Whether the activity of the current state, if any, has started or waits to start."""
        self._taken: list[TakenArrow] = []
        """The transitions since the last report."""
        self._last_report: CoordinationReport | None = None
        self._transitions = 0

    # --- input ------------------------------------------------------------------------------------

    def enqueue_event(self, event: str) -> None:
        """Enqueue an event. From any thread."""
        self._enqueue(lambda: self._events.append(event))

    def enqueue_variable(self, name: str, value: Any) -> None:
        """Enqueue a new value of a variable. From any thread."""
        self._enqueue(lambda: self._variables.update({name: value}))

    def _enqueue(self, change: Callable[[], object]) -> None:
        self._inbox.append(change)
        self._task.wake()

    def run_to_end(self) -> CoordinationEnd:
        """Run the machine to its end. No task that it has started outlives it."""
        try:
            for variable in self._machine.variables:
                self._variables[variable.name] = self._task.get_variable(variable, None)
            while not self._is_over():
                self._advance()
                self._wait()
        except BaseException:
            # Without central no task can be killed; central kills them when the module is lost.
            with suppress(TcaError):
                self._work.kill_all(f"{self._machine!r} has ended")
            raise
        return CoordinationEnd(
            self._interpreter.state.label, self._transitions, self._work.kept, self._work.wasted
        )

    def _is_over(self) -> bool:
        return self._interpreter.is_ended and self._last_report is not None and self._work.is_over

    def _wait(self) -> None:
        """Wait for the next event, and process all that have arrived."""
        if not self._is_over():
            due = self._work.kill_due
            timeout = None if due is None else max(0.0, due - self._task.time())
            self._task.wait_until(lambda: bool(self._inbox), timeout, on=self._work.running_tasks)
        self._failed_since_event.clear()
        while self._inbox:
            self._inbox.popleft()()
        self._work.kill_late()

    # --- transitions and activities ---------------------------------------------------------------

    def _advance(self) -> None:
        """Advance the machine as far as it can; then look ahead."""
        while True:
            while self._try_transition():
                pass
            decision = self._decide()
            for stop in decision.stops:
                self._work.drop(stop.state, why_stopped(self._machine.chart, stop))
            self._begin_current()
            if not (self._unmet or self._events):
                break
            self._report(decision)
        self._begin_ahead(decision)
        self._report(decision)

    def _decide(self) -> Decision:
        if self._look_ahead is None:
            return Decision([])
        situation = self._situation()
        present = self._work.present(self._interpreter.current, situation, is_new=bool(self._taken))
        return self._look_ahead.decide(self._machine.automaton(situation, self._mistakes), present)

    def _situation(self) -> Situation:
        current = self._work.current
        return Situation(
            self._interpreter.state.label,
            self._work.plain_facts,
            self._variables,
            current.progress if current is not None else 0.0,
        )

    def _begin_current(self) -> None:
        """Start the activity of the current state, if it has one that need not wait.

        After the end of the machine, undo wasted work instead.
        """
        if self._interpreter.is_ended:
            self._work.restore()
        activity = self._interpreter.state.activity
        if activity is not None and self._work.current is None:
            self._unmet = self._work.begin(self._interpreter.current, activity)
        self._is_entered = True

    def _begin_ahead(self, decision: Decision) -> None:
        ranks = {foreseen.state: rank for rank, foreseen in enumerate(decision.preview, 1)}
        for state, rank in ranks.items():
            work, activity = self._work.ahead(state), self._machine.states[state].activity
            share = decision.shares.get(state, work.share if work is not None else 0.0)
            if (
                activity is None
                or not share
                or (work is not None and (share, rank) == (work.share, work.rank))
            ):
                continue
            consequence = "does not run early" if work is None else "keeps its speed"
            make_data = partial(activity.data_at, share, rank)
            data = self._mistakes.value_or(None, f"{activity!r} {consequence}", make_data)
            if data is None:
                continue
            if work is None:
                self._work.begin_ahead(state, activity, share, rank, data)
            else:
                work.share, work.rank, work.data = share, rank, data
        self._work.adapt_speeds()

    def _try_transition(self) -> bool:
        """Take one transition, if possible. Returns whether one was taken.

        A state is left only after its activity was started, or could not start.
        """
        if not self._is_entered:
            return False
        current = self._work.current
        if self._unmet:
            is_cycle = self._interpreter.current in self._failed_since_event
            self._failed_since_event.add(self._interpreter.current)
            return (not is_cycle and self._take_arrow(FAILED)) or self._fail()
        if current is not None and current.failed_task is not None:
            return self._take_arrow(FAILED) or self._fail()
        if current is not None and current.is_done and self._take_arrow(DONE):
            return True
        while self._events:
            if self._take_arrow(self._events.popleft()):
                return True
        return False

    def _take_arrow(self, event: str) -> bool:
        taken = self._interpreter.take(event, self._situation())
        if not taken:
            return False
        self._unmet = ""
        self._taken += taken
        self._transitions += len(taken)
        self._work.leave(f"{self._machine!r} has left its state by '{event}'")
        self._is_entered = self._work.enter(self._interpreter.current)
        return True

    def _fail(self) -> bool:
        """Fail the run: the current activity has failed, and the machine has no arrow for that."""
        label = self._interpreter.state.label
        if self._unmet:
            raise NEEDS_NOT_MET(text=f"'{label}' can't begin: {self._unmet}")
        assert self._work.current is not None
        failed = self._work.current.failed_task
        assert failed is not None
        if failed.failure is not None:
            raise failed.failure.error_of(failed.sent)
        raise ACTIVITY_STOPPED(text=f"'{label}': {failed.sent} was killed: {failed.killed}")

    # --- reports ----------------------------------------------------------------------------------

    def _report(self, decision: Decision) -> None:
        role_changes, last_report = self._work.role_changes(), self._last_report
        for arrow in self._taken[:-1]:
            refused = last_report.refused if last_report is not None else []
            self._task.report(
                CoordinationReport(arrow.after, arrow.symbol, arrow.before, refused=refused)
            )
        last = self._taken[-1] if self._taken else TakenArrow(-1, "", -1)
        self._taken.clear()
        preview = [_rounded(foreseen) for foreseen in decision.preview]
        report = CoordinationReport(
            self._interpreter.current,
            last.symbol,
            last.before,
            preview,
            role_changes,
            decision.refused,
        )
        if (
            last.symbol
            or role_changes
            or last_report is None
            or (last_report.preview, last_report.refused) != (preview, decision.refused)
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
