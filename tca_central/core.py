"""Central's core: all of its state and the one function that changes it. Knows no socket, file, clock or thread.

Theory of operation. ``handle`` takes one event, lets the row of HANDLERS for it record what happened, then settles:
points are reached, startable tasks are given to resources, ended tasks are reported, until nothing moves. It returns
what the world must do: first the journal entry with every fact, then the messages to send. The same events always
give the same effects. The rules live apart and do not know each other: registry (who and what), task_tree (structure),
agenda (points and constraints), resources and dispatcher (capacity and order); this file alone joins them.
"""

from collections.abc import Callable
from typing import Any

from tca_central import joining, requests
from tca_central.agenda import Agenda
from tca_central.dispatcher import Dispatcher
from tca_central.errors import RequestError
from tca_central.events import BadBytes, ConnectionLost, Effect, Event, Received, Record, Transmit
from tca_central.registry import Connection, MessageType, Registry
from tca_central.resources import Delivery
from tca_central.task_tree import Task, TaskTree
from tca_wire import facts, headers
from tca_wire.headers import Accepted, MessageClass, MessageFormat, Outcome, Refusal, Refused, ToModule
from tca_wire.points import TaskId

REMEMBERED_OUTCOMES = 10_000
"""Ended tasks whose failure or result can still be asked for."""


class Central:
    """The state of everything. ``handle`` is the only way it changes; all else that is public are questions."""

    def __init__(self, epoch: str = "test") -> None:
        self.epoch = epoch
        self.registry = Registry()
        self.tree = TaskTree(MessageType(MessageFormat("root", MessageClass.GOAL, "", ""), "central"))
        self.facts: list[Any] = []  #: of the event being handled
        self.agenda = Agenda(self.tree, self.facts)
        self.dispatcher = Dispatcher(self.facts, self._deliver)
        self.collectors: dict[int, requests.Collector] = {}  #: by delivery, of multi-queries under way
        self.outcomes: dict[int, tuple[Outcome, str, str, bytes]] = {}  #: of ended tasks, oldest first
        self.events = 0  #: number of events handled
        self._messages: list[Effect] = []

    def handle(self, event: Event) -> list[Effect]:
        """Let *event* happen; what must be done about it, in that order. Any exception is a bug in central."""
        self.events += 1
        if isinstance(event, Received):
            self._on_message(event)
        elif isinstance(event, ConnectionLost):
            if connection := self.registry.connections.get(event.connection):
                joining.leave(self, connection, event.why, lost=True)
        elif isinstance(event, BadBytes):
            self._refuse(event.connection, 0, Refusal.PROTOCOL, event.why)
        self._settle()
        effects = self._messages
        if self.facts:
            effects = [Record(facts.Entry(self.events, event.time, self.facts[:])), *effects]
            self.facts.clear()
        self._messages = []
        return effects

    # --- an event ----------------------------------------------------------------------------------------------

    def _on_message(self, event: Received) -> None:
        header = event.header
        connection = self.registry.connections.get(event.connection)
        if connection is None:
            if isinstance(header, headers.Hello):
                self._guarded(event.connection, header.number, lambda: joining.hello(self, event.connection, header))
            else:
                self._messages.append(Transmit(event.connection, headers.Unknown()))
            return
        number = getattr(header, "number", 0)
        if number and number <= connection.last_number and not isinstance(header, headers.Hello):
            self._repeat(connection, number)
            return
        connection.last_number = max(connection.last_number, number)
        handler = HANDLERS[type(header)]
        self._guarded(connection.id, number, lambda: handler(self, connection, header, event.body))

    def _guarded(self, connection_id: Any, number: int, do: Callable[[], None]) -> None:
        """A request that can't be done is refused and leaves nothing behind."""
        try:
            do()
        except RequestError as error:
            self._refuse(connection_id, number, error.refusal, error.text)

    def _refuse(self, connection_id: Any, number: int, refusal: Refusal, text: str) -> None:
        connection = self.registry.connections.get(connection_id)
        self.facts.append(facts.RequestRefused(connection.module.name if connection else "?", refusal, text))
        if connection and number:
            connection.outstanding.pop(number, None)
            self.send(connection, number, Refused(number, refusal, text))
        else:
            self._messages.append(Transmit(connection_id, Refused(number, refusal, text)))

    def _repeat(self, connection: Connection, number: int) -> None:
        """A request came twice: give the answer that it had, or say again that it was taken."""
        header, body = connection.answers.get(number, (None, b""))
        if header is None:
            known = connection.outstanding.get(number)
            header = Accepted(number, getattr(known, "id", 0))
            if known is None:
                text = f"request {number} was answered before, and its answer is no longer kept"
                header = Refused(number, Refusal.TOO_LATE, text)
        self._messages.append(Transmit(connection.id, header, body))

    # --- what the rules agree on -----------------------------------------------------------------------------------

    def _settle(self) -> None:
        """Let everything happen that may, until nothing moves."""
        agenda = self.agenda
        agenda.settle()
        while agenda.startable or agenda.ended or agenda.met or agenda.withdrawn:
            while agenda.withdrawn:
                self.dispatcher.withdraw(agenda.withdrawn.popleft())
            while agenda.startable:
                task = agenda.startable.popleft()
                if task.requested and not task.killed:
                    self.dispatcher.route(task)
            while agenda.ended:
                self._ended(agenda.ended.popleft())
            while agenda.met:
                task, wait = agenda.met.popleft()
                requests.answer_wait(self, wait, self.outcome(task))
            agenda.settle()

    def _deliver(self, delivery: Delivery, slot: Connection) -> None:
        """A handler gets a message: the one place where messages leave for modules."""
        resource = slot.resource
        assert resource is not None
        self.facts.append(facts.Delivered(delivery.id, delivery.message_id, resource.module, resource.name))
        task_id = TaskId(0)
        if isinstance(delivery, Task):
            task_id = TaskId(delivery.id)
            self.agenda.started(delivery)
        header = headers.Deliver(delivery.id, delivery.message.name, task_id)
        self._messages.append(Transmit(slot.id, header, delivery.body))

    def _ended(self, task: Task) -> None:
        outcome = self.outcome(task)
        if outcome[0] is not Outcome.DONE or outcome[3]:
            self.outcomes[task.id] = outcome
            if len(self.outcomes) > REMEMBERED_OUTCOMES:
                del self.outcomes[next(iter(self.outcomes))]

    def outcome(self, task: Task) -> tuple[Outcome, str, str, bytes]:
        """How a task ended, or stands: outcome, failure's name, text, and result or failure data."""
        if task.failure is not None:
            return Outcome.FAILED, *task.failure
        if task.killed:
            return Outcome.KILLED, "", task.killed, b""
        return Outcome.DONE, "", "", task.result

    # --- sending -----------------------------------------------------------------------------------------------------

    def send(self, connection: Connection, number: int, header: ToModule, body: bytes = b"") -> None:
        """Answer a request, for good; the answer is kept in case the request is repeated."""
        connection.remember(number, header, body)
        self._messages.append(Transmit(connection.id, header, body))

    def tell(self, connection: Connection, header: ToModule, body: bytes = b"") -> None:
        """Send a message that is no final answer."""
        self._messages.append(Transmit(connection.id, header, body))

    def new_id(self) -> int:
        """The next id; ids are never used again."""
        self.tree.newest += 1
        return self.tree.newest


HANDLERS: dict[type, Callable[[Central, Connection, Any, bytes], None]] = {
    headers.Hello: joining.on_hello_again,
    headers.Register: joining.on_register,
    headers.Unregister: joining.on_unregister,
    headers.Send: requests.on_send,
    headers.Reply: requests.on_reply,
    headers.Fail: requests.on_fail,
    headers.Constrain: requests.on_constrain,
    headers.WaitFor: requests.on_wait_for,
    headers.GiveUp: requests.on_give_up,
    headers.Kill: requests.on_kill,
    headers.Ask: requests.on_ask,
    headers.Bye: joining.on_bye,
}
"""One row per message: what happens when it arrives."""
