"""The states of tasks, derived slowly from the tables of transitions and from docs/decisions/0082.
Each task has a list of its changes. An observer must have received exactly these changes, in this
order.

The reference takes from central the handler, delivery, kill, retry and end of each task. Other
tests judge these.
"""

from collections.abc import Iterable
from typing import Any

from properties.life_of_states import LIFE_CYCLES, AskedChange

from tca_central.life_cycles.changes import MOST_ASKED
from tca_wire.journal import facts
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, Transition
from tca_wire.packets import headers
from tca_wire.points import ALL_MOMENTS
from tca_wire.vocabulary import Party, Refusal

Seen = tuple[str, str, int]
"""A transition, its target state and its number."""


class TrackedTask:
    """A task with its state and its changes."""

    def __init__(self, cycle: LifeCycle, goal: bytes) -> None:
        self.cycle, self.goal = cycle, goal
        self.state, self.serial = cycle.initial, 0
        self.changes: list[Seen] = [("initiated", cycle.initial, 0)]
        #: requests of clients that the handler has received, each with its number and data
        self.open: list[tuple[Transition, int, bytes]] = []
        self.newest_of_client = 0
        self.delivery = 0
        self.deciding = 0  #: the exception handler for the failure of the task's handler
        self.is_delivered = False
        self.reached = 0
        self.is_killed = self.is_over = self.has_failed = self.is_retried = False

    def take(self, name: str, state: str) -> None:
        self.state = state
        self.serial += 1
        self.changes.append((name, state, self.serial))

    def row(self, state: str, name: str, by: Party) -> Transition | None:
        found = [one for one in self.cycle.transitions if (one.source, one.name) == (state, name)]
        return found[0] if found and found[0].by in (by, Party.BOTH) else None

    def leads_to_an_answer(self, state: str) -> bool:
        """Whether the server may accept, refuse or stop in *state*."""
        answers = (Effect.TAKE_GOAL, Effect.REFUSE, Effect.STOP)
        return any(one.source == state and one.effect in answers for one in self.cycle.transitions)

    def name_of(self, state: str, effect: Effect) -> str:
        return next(
            (
                one.name
                for one in self.cycle.transitions
                if (one.source, one.effect) == (state, effect)
            ),
            "",
        )


WITH_DATA = {Party.CLIENT: (Effect.NEW_GOAL,), Party.SERVER: (Effect.RESULT, Effect.TAKE_GOAL)}


class Reference:
    """The states of all tasks."""

    def __init__(self) -> None:
        self.tasks: dict[int, TrackedTask] = {}
        #: handlers that accept tasks themselves, as module and message
        self.accepts: set[tuple[str, str]] = set()
        self.names: dict[int, str] = {}
        self.killed_by_wish: set[int] = set()
        #: exception handlers that did not deal with their failure; 0 stands for no handler
        self.undecided = {0}

    # --- requests ---------------------------------------------------------------------------------

    def ask(self, asked: AskedChange) -> None:
        """Apply a request, and check its answer."""
        task = self.tasks.get(asked.task)
        if task is None:
            return  # a monitor, which central carries out
        if task.is_over or task.is_killed:
            assert self.is_ignored(asked) or isinstance(asked.answer, headers.Refused), asked
            return
        expected = self.refusal(task, asked)
        if expected is not None:
            assert isinstance(asked.answer, headers.Refused), (asked, task.changes)
            assert asked.answer.refusal is expected, (asked, task.changes)
            return
        before, own = len(task.changes), task.serial + 1  # a client's own transition
        if asked.by is Party.SERVER:
            self.by_server(task, asked)
        elif (row := task.row(task.state, asked.name, Party.CLIENT)) is not None:
            self.by_client(task, row, asked)
        is_taken = len(task.changes) > before or asked.task in self.killed_by_wish
        number = own if asked.by is Party.CLIENT else task.serial
        assert asked.answer.id == (number if is_taken else 0), (asked, task.changes)

    @staticmethod
    def is_ignored(asked: AskedChange) -> bool:
        return isinstance(asked.answer, headers.Accepted) and asked.answer.id == 0

    def refusal(self, task: TrackedTask, asked: AskedChange) -> Refusal | None:
        """Return the refusal that a request must get; None if it is accepted or ignored."""
        if asked.serial > task.serial:
            return Refusal.PROTOCOL  # the sender names a change that has not happened
        row, _ = self.chosen(task, asked)
        if row is None:
            if not any(task.row(state, asked.name, asked.by) for state in task.cycle.states):
                return Refusal.UNKNOWN
            if asked.by is Party.CLIENT:
                return None if -1 < asked.serial < task.serial else Refusal.TOO_LATE
            return None if -1 < asked.serial < task.newest_of_client else Refusal.PROTOCOL
        if (
            asked.by is Party.SERVER
            and task.cycle.is_over(row.target)
            and row.effect is not Effect.STOP
        ):
            return Refusal.PROTOCOL  # a handler ends its task by returning or failing
        if asked.body and row.effect not in WITH_DATA[asked.by]:
            return Refusal.PROTOCOL
        is_told = asked.takes is not None and asked.name in asked.takes
        if asked.by is Party.CLIENT and not is_told and not task.leads_to_an_answer(row.target):
            return Refusal.PROTOCOL  # the handler would not receive it
        return None

    def chosen(self, task: TrackedTask, asked: AskedChange) -> tuple[Transition | None, bool]:
        """Return the requested transition, and whether it comes before the requests of clients that
        the server has not seen. It does if it is possible in the state before those requests. Only
        a result that is possible now comes after them.
        """
        now, unseen = task.row(task.state, asked.name, asked.by), self.unseen(task, asked)
        before = task.row(unseen[0][0].source, asked.name, asked.by) if unseen else None
        if before is None or (now is not None and now.effect is Effect.RESULT):
            return now, False
        return before, True

    @staticmethod
    def unseen(task: TrackedTask, asked: AskedChange) -> list[tuple[Transition, int, bytes]]:
        if asked.by is Party.CLIENT or asked.serial < 0:
            return []
        return [one for one in task.open if one[1] > asked.serial]

    def by_client(self, task: TrackedTask, row: Transition, asked: AskedChange) -> None:
        if len(task.open) >= MOST_ASKED:
            task.open = [one for one in task.open if task.leads_to_an_answer(one[0].target)]
        task.take(row.name, row.target)
        if asked.takes is not None and row.name in asked.takes:
            task.open.append((row, task.serial, asked.body))
            task.newest_of_client = task.serial
            return
        task.newest_of_client = task.serial
        refusing = asked.refuses if asked.takes is not None else asked.refuses_next
        may_refuse = asked.takes is not None or row.source != task.cycle.initial
        refusal = task.name_of(task.state, Effect.REFUSE)
        is_retried = any(
            isinstance(one, facts.Retried) and one.task == asked.task for one in asked.facts
        )
        task.open = []
        if refusal and (
            (row.name in refusing and may_refuse)
            or (row.effect is Effect.NEW_GOAL and not is_retried)
        ):
            task.take(refusal, "running")
        elif row.effect is Effect.NEW_GOAL:
            task.goal = asked.body
            task.take(task.name_of(task.state, Effect.TAKE_GOAL), "running")
        else:
            self.killed_by_wish.add(asked.task)

    def by_server(self, task: TrackedTask, asked: AskedChange) -> None:
        unseen, (row, is_first) = self.unseen(task, asked), self.chosen(task, asked)
        if row is None:
            return  # the request comes too late, and is ignored
        if row.effect is Effect.RESULT:
            task.take(row.name, row.target)
            seen = asked.serial if asked.serial >= 0 else task.serial
            task.open = [
                one for one in task.open if one[1] > seen or task.leads_to_an_answer(one[0].target)
            ]
        elif row.effect is Effect.STOP:
            self.killed_by_wish.add(asked.task)
            task.open = []
            return
        else:
            goals = [
                body
                for one, number, body in task.open
                if body and (one, number, body) not in unseen
            ]
            if row.effect is Effect.TAKE_GOAL and (goal := asked.body or b"".join(goals[-1:])):
                task.goal = goal  # the server may have changed the requested goal
            task.open = []
            task.take(row.name, row.target)
        for one, number, body in unseen if is_first else ():
            row_again = task.row(task.state, one.name, Party.CLIENT)
            if row_again is not None:
                task.take(row_again.name, row_again.target)
                task.open = [kept for kept in task.open if kept[1] != number] + [
                    (row_again, number, body)
                ]

    # --- what other facts imply -------------------------------------------------------------------

    def note(self, recorded: Iterable[Any]) -> None:
        """Apply the facts of one event."""
        returned: set[int] = set()
        for fact in recorded:
            match fact:
                case facts.Returned():
                    returned |= {
                        number for number, task in self.tasks.items() if task.delivery == fact.id
                    }
                case facts.Caught() | facts.Recovered() | facts.Unhandled() if (
                    fact.task in self.tasks
                ):
                    self.search_ended(self.tasks[fact.task], fact, returned)
                case facts.StateChanged() if fact.by is Party.CENTRAL and fact.task in returned:
                    self.answer_by_central(self.tasks[fact.task], fact)
                case facts.HandlerAdded() if fact.accepts:
                    self.accepts.add((fact.module, fact.message))
                case facts.Received() if (
                    fact.message_class.is_task and not fact.message_class.is_monitor
                ):
                    cycle = LIFE_CYCLES.get(fact.message, GENERAL)
                    self.tasks[fact.id], self.names[fact.id] = (
                        TrackedTask(cycle, fact.body),
                        fact.message,
                    )
                case facts.Queued() | facts.Delivered() if fact.message_id in self.tasks:
                    self.given(fact)
                case facts.Unqueued():
                    self.recalled(fact.id)
                case facts.Failed() if not fact.is_beside and fact.id in self.tasks:
                    self.tasks[fact.id].has_failed, self.tasks[fact.id].deciding = True, 0
                case facts.Reissued() | facts.NotResolved():
                    self.undecided.add(fact.handler)
                case facts.Retried() | facts.Killed() | facts.Reached() if fact.task in self.tasks:
                    self.apply_other(self.tasks[fact.task], fact)
        for task in (self.tasks[number] for number in returned if number in self.tasks):
            is_failing = task.has_failed or task.is_retried or task.is_killed or task.is_over
            wanted = [one for one in task.open if task.leads_to_an_answer(one[0].target)]
            assert is_failing or not wanted, (
                f"task {next(n for n in self.tasks if self.tasks[n] is task)}: no answer to {wanted}"
            )
            task.open = task.open if is_failing else []
        killed = [number for number in self.killed_by_wish if not self.tasks[number].is_killed]
        assert not killed, f"{killed} should have been killed"

    def given(self, fact: facts.Queued | facts.Delivered) -> None:
        """Note that a task is queued or delivered. The task restarts if it had another delivery, or
        if this delivery was made before.
        """
        task = self.tasks[fact.message_id]
        if task.delivery and (fact.id != task.delivery or task.is_delivered):
            self.restart(task)
        task.delivery, task.is_delivered = fact.id, isinstance(fact, facts.Delivered)
        is_new = task.is_delivered and task.state == task.cycle.initial
        if is_new and (fact.module, self.names[fact.message_id]) not in self.accepts:
            task.take(task.cycle.accepted.name, task.cycle.accepted.target)

    def recalled(self, delivery: int) -> None:
        """Note that a delivery was recalled before its handler began. The task is not queued again
        yet.
        """
        for task in self.tasks.values():
            if task.delivery == delivery and task.is_delivered and not task.is_over:
                self.restart(task)
                task.is_delivered = False

    @staticmethod
    def restart(task: TrackedTask) -> None:
        """Put a task back into its initial state, because it is queued again."""
        task.open, task.newest_of_client = [], 0
        is_to_end = task.name_of(task.state, Effect.STOP)  # a kill follows
        task.has_failed = task.is_retried = False
        if task.state != task.cycle.initial and not is_to_end:
            task.take("restarted", task.cycle.initial)

    def search_ended(
        self,
        task: TrackedTask,
        fact: facts.Caught | facts.Recovered | facts.Unhandled,
        returned: set[int],
    ) -> None:
        """Note that the search for an exception handler continues or ends. Failures raised beside
        the task's handler leave the handling open.
        """
        if isinstance(fact, facts.Caught):
            task.deciding = task.deciding if fact.is_beside else fact.handler
        elif task.has_failed and (
            task.deciding in self.undecided
            if isinstance(fact, facts.Unhandled)
            else task.deciding == fact.handler
        ):
            task.has_failed = False
            returned.add(fact.task)

    def answer_by_central(self, task: TrackedTask, fact: facts.StateChanged) -> None:
        """Let central answer a client's request, because the handler returned without an answer."""
        (row, number, body), task.open = task.open[-1], []
        assert row.target == task.state, (row, number)
        is_granted = fact.transition == task.name_of(task.state, Effect.TAKE_GOAL)
        assert is_granted or fact.transition == task.name_of(task.state, Effect.REFUSE)
        task.goal = body if is_granted else task.goal
        task.take(fact.transition, "running")

    def apply_other(
        self, task: TrackedTask, fact: facts.Retried | facts.Killed | facts.Reached
    ) -> None:
        """Note a retry, a kill or a reached point. None of them changes the task's state."""
        match fact:
            case facts.Retried():
                task.goal, task.is_retried = fact.body or task.goal, True
            case facts.Killed():
                task.is_killed = True
                self.undecided.add(fact.task)
            case facts.Reached():
                task.reached |= fact.moments
                task.is_over = task.reached == ALL_MOMENTS
