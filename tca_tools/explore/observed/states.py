"""The states of tasks: as the facts say, and as somebody who observes all of them has been told. They must agree, and
who observes must miss no change.
"""

from typing import NamedTuple

import msgspec

from tca_wire.journal import facts
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, read_life_cycle
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import StateChange
from tca_wire.points import ALL_MOMENTS


class StateNow(msgspec.Struct):
    """How a task stands."""

    message: str
    cycle: LifeCycle
    state: str
    goal: bytes = b""
    wanted: bytes = b""
    """The goal that a client wants it to have."""
    delivery: int = 0
    reached: int = 0
    is_killed: bool = False


class Told(NamedTuple):
    """What an observer knows of a task."""

    serial: int
    state: str
    goal: bytes
    is_over: bool


class States:
    """Of all tasks that live."""

    def __init__(self) -> None:
        self.of: dict[int, StateNow] = {}
        self.told: dict[int, Told] | None = None  #: what the observer knows of each; None: there is none
        self._cycles: dict[str, LifeCycle] = {}
        self._accepts: set[tuple[str, str]] = set()  #: modules and messages whose handlers accept tasks themselves
        self._missed = ""

    def take(self, fact: facts.Fact) -> None:
        """Central has recorded that."""
        match fact:
            case facts.FormatDefined():
                self._cycles[fact.message] = read_life_cycle(fact.life_cycle)
            case facts.HandlerAdded() if fact.accepts:
                self._accepts.add((fact.module, fact.message))
            case facts.HandlerRemoved():
                self._accepts.discard((fact.module, fact.message))
            case facts.Received() if fact.message_class.is_task and not fact.message_class.is_monitor:
                cycle = self._cycles.get(fact.message, GENERAL)
                self.of[fact.id] = StateNow(fact.message, cycle, cycle.initial, fact.body)
            case facts.Queued() | facts.Delivered() if fact.message_id in self.of:
                self._give(self.of[fact.message_id], fact)
            case facts.StateChanged():
                self._change(self.of[fact.task], fact)
            case facts.Retried() | facts.Killed() | facts.Reached() if fact.task in self.of:
                self._go_on(self.of[fact.task], fact)

    def _give(self, task: StateNow, fact: facts.Queued | facts.Delivered) -> None:
        is_again = task.delivery and fact.id != task.delivery
        task.delivery = fact.id
        if is_again:
            task.state = task.cycle.initial
        is_new = isinstance(fact, facts.Delivered) and task.state == task.cycle.initial
        if is_new and (fact.module, task.message) not in self._accepts:
            task.state = task.cycle.accepted.target

    def _change(self, task: StateNow, fact: facts.StateChanged) -> None:
        row = next(one for one in task.cycle.transitions if (one.name, one.target) == (fact.transition, fact.state))
        task.wanted = fact.body if row.effect is Effect.NEW_GOAL else task.wanted
        task.goal = task.wanted if row.effect is Effect.TAKE_GOAL else task.goal
        task.state = fact.state

    @staticmethod
    def _go_on(task: StateNow, fact: facts.Retried | facts.Killed | facts.Reached) -> None:
        match fact:
            case facts.Retried():
                task.goal = fact.body or task.goal
            case facts.Killed():
                task.is_killed = True
            case facts.Reached():
                task.reached |= fact.moments
                if task.reached == ALL_MOMENTS:
                    task.state = task.cycle.cancelled if task.is_killed else task.cycle.done

    def hear(self, header: object, body: bytes) -> None:
        """The observer is told something."""
        if self.told is None or not isinstance(header, Answer) or not body:
            return
        change = msgspec.msgpack.decode(body, type=StateChange)
        number = next((number for number in self.of if int(number) == change.task), change.task)  # which only names it
        known = self.told.get(number)
        expected = known.serial + 1 if known is not None else 0
        if change.serial != expected:
            self._missed = f"change {change.serial} of task {change.task} was told where {expected} comes next"
        self.told[number] = Told(change.serial, change.state, change.goal, change.is_over)

    def breach(self) -> str:
        """The error in what the observer knows; "" if there is none. What has ended is forgotten."""
        for number, task in self.of.items():
            if self.told is not None:
                told = self.told.get(number)
                if told is None or (told.state, told.goal) != (task.state, task.goal):
                    return f"task {number} is {task.state}, and who observes was told {told and told.state}"
                if told.is_over:
                    del self.told[number]
        for number, task in list(self.of.items()):
            if task.cycle.is_over(task.state):
                del self.of[number]
        return self._missed
