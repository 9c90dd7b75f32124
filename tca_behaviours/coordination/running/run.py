"""One run of a machine: it hears of tasks, variables and events, and starts and stops activities.

All happens in the thread that handles the coordinator's task. It waits for whatever comes first;
then the machine goes on as far as it can, and looks ahead anew.
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
from tca_behaviours.coordination.running.failures import FailureNotes
from tca_behaviours.coordination.running.messages import (
    ACTIVITY_STOPPED,
    NEEDS_NOT_MET,
    CoordinationEnd,
)
from tca_module import Task, TcaError
from tca_wire.coordination import CoordinationReport, Foreseen
from tca_wire.text.early_work import came_late, why_not_early, why_stopped


class CoordinationRun:
    """A machine at work, as a task."""

    def __init__(
        self,
        machine: Coordination,
        interpreter: Interpreter,
        look_ahead: LookAhead | None,
        task: Task,
        failures: FailureNotes,
        patience: float,
    ) -> None:
        """*interpreter*: the machine's, in its first state."""
        self._machine = machine
        self._look_ahead = look_ahead
        self._task = task
        self._interpreter = interpreter
        self._heard = deque[Callable[[], object]]()
        self._events = deque[str]()
        self._variables: dict[str, Any] = {}
        self._mistakes = look_ahead.mistakes if look_ahead is not None else Mistakes()
        self._work = ActivitiesAtWork(
            machine.facts, task, failures, patience, self._heard.append, self._mistakes
        )
        self._unmet = ""
        """Why the current activity can't begin, in words; "" if it can."""
        self._failed_at_once = set[int]()
        """States that could not begin, since something was heard last: coming back to one goes
        round for ever.
        """
        self._is_entered = False
        """Its activity has begun or waits to begin, if it has one."""
        self._taken: list[TakenArrow] = []
        """Transitions of which nobody has been told."""
        self._told: CoordinationReport | None = None
        self._transitions = 0

    # --- what happens -----------------------------------------------------------------------------

    def note_event(self, event: str) -> None:
        """An event has happened. From any thread."""
        self._hear(lambda: self._events.append(event))

    def note_variable(self, name: str, value: Any) -> None:
        """A variable has a new value. From any thread."""
        self._hear(lambda: self._variables.update({name: value}))

    def _hear(self, happening: Callable[[], object]) -> None:
        self._heard.append(happening)
        self._task.wake()

    def until_end(self) -> CoordinationEnd:
        """Run the machine until it has ended. Nothing that it has started runs on, whatever
        happens.
        """
        try:
            for variable in self._machine.variables:
                self._variables[variable.name] = self._task.get_variable(variable, None)
            while not self._is_over():
                self._go_on()
                self._wait()
        except BaseException:
            with suppress(
                TcaError
            ):  # without central there is nothing to stop, and it ends them itself
                self._work.kill_all(f"{self._machine!r} has ended")
            raise
        return CoordinationEnd(
            self._interpreter.state.label, self._transitions, self._work.kept, self._work.wasted
        )

    def _is_over(self) -> bool:
        return self._interpreter.is_ended and self._told is not None and self._work.is_over

    def _wait(self) -> None:
        """Wait until something has happened; and take it in."""
        if not self._is_over():
            due = self._work.kill_due
            timeout = None if due is None else max(0.0, due - self._task.time())
            self._task.wait_until(lambda: bool(self._heard), timeout, on=self._work.living)
        self._failed_at_once.clear()
        while self._heard:
            self._heard.popleft()()
        self._work.kill_late()

    # --- what comes of it -------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Let the machine go on as far as it can; then look ahead."""
        while True:
            while self._move():
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
        """Start the activity of the current state, if it has one and nothing is in its way any
        more; at the end, what undoes early work.
        """
        if self._interpreter.is_ended:
            self._work.restore()
        activity = self._interpreter.state.activity
        if activity is not None and self._work.current is None:
            self._unmet = self._work.begin(self._interpreter.current, activity)
        self._is_entered = True

    def _begin_ahead(self, decision: Decision) -> None:
        for state, rank in {
            one.state: rank for rank, one in enumerate(decision.preview, 1)
        }.items():
            work, activity = self._work.ahead(state), self._machine.states[state].activity
            share = decision.shares.get(state, work.share if work is not None else 0.0)
            if (
                activity is None
                or not share
                or (work is not None and (share, rank) == (work.share, work.rank))
            ):
                continue
            otherwise = "does not run early" if work is None else "runs on as it does"
            make = partial(activity.data_at, share, rank)
            data = self._mistakes.otherwise(None, f"{activity!r} {otherwise}", make)
            if data is None:
                continue
            if work is None:
                self._work.begin_ahead(state, activity, share, rank, data)
            else:
                work.share, work.rank, work.data = share, rank, data
        self._work.adapt_speeds()

    def _move(self) -> bool:
        """Take one transition, if there is one; whether there was. What a state does is tried
        before it is left.
        """
        if not self._is_entered:
            return False
        current = self._work.current
        if self._unmet:
            is_round = self._interpreter.current in self._failed_at_once
            self._failed_at_once.add(self._interpreter.current)
            return (not is_round and self._take(FAILED)) or self._fail()
        if current is not None and current.failed_task is not None:
            return self._take(FAILED) or self._fail()
        if current is not None and current.is_done and self._take(DONE):
            return True
        while self._events:
            if self._take(self._events.popleft()):
                return True
        return False

    def _take(self, event: str) -> bool:
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
        """The current activity has failed, and the machine has no arrow for that."""
        label = self._interpreter.state.label
        if self._unmet:
            raise NEEDS_NOT_MET(text=f"'{label}' can't begin: {self._unmet}")
        assert self._work.current is not None
        failed = self._work.current.failed_task
        assert failed is not None
        if failed.failure is not None:
            raise failed.failure.error_of(failed.sent)
        raise ACTIVITY_STOPPED(text=f"'{label}': {failed.sent} was killed: {failed.killed}")

    # --- what is told -----------------------------------------------------------------------------

    def _report(self, decision: Decision) -> None:
        news, told = self._work.role_changes(), self._told
        for arrow in self._taken[:-1]:
            passed = told.refused if told is not None else []
            self._task.report(
                CoordinationReport(arrow.after, arrow.symbol, arrow.before, refused=passed)
            )
        last = self._taken[-1] if self._taken else TakenArrow(-1, "", -1)
        self._taken.clear()
        preview = [_rounded(one) for one in decision.preview]
        report = CoordinationReport(
            self._interpreter.current, last.symbol, last.before, preview, news, decision.refused
        )
        if (
            last.symbol
            or news
            or told is None
            or (told.preview, told.refused) != (preview, decision.refused)
        ):
            self._task.report(report)
            self._told = report
        for objection in came_late(told, report) if told is not None else ():
            why = why_not_early(self._machine.chart, objection)
            if why.remedy:
                self._mistakes.tell(*why)


def _rounded(foreseen: Foreseen) -> Foreseen:
    """Likelihoods that change all the time are no news at each change."""
    return Foreseen(foreseen.state, round(foreseen.likelihood, 3), round(foreseen.probability, 3))
