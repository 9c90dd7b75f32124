"""Server: a handler of tasks as an object, with a method for each thing that clients may want; most are optional.

Between messages, and while a handler waits, the thread of its resource gives requests to these methods.
"""

from abc import ABC, abstractmethod
from collections.abc import Coroutine
from typing import Any, Generic

from tca_module.checks import check_function
from tca_module.errors import ORDINARY, MisuseError, TaskKilled
from tca_module.following.followed_task import life_cycle_of
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import Rejection
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.task import Task
from tca_module.sending.task_requests import TaskRequest
from tca_module.serving.handlers import Handler
from tca_module.session.open_deliveries import working_on
from tca_wire.life_cycles import Effect, LifeCycle
from tca_wire.messages.declarations import D, Message, R
from tca_wire.packets.headers import Deliver
from tca_wire.packets.parts import HandlerFormat
from tca_wire.vocabulary import Party


class Server(ABC, Generic[D, R]):
    """Handles the tasks of a message: ``module.serve(GRASP, Grasping())``.

    ::

        class Grasping(Server[Grasp, Held]):
            def initiated(self, task: Task, goal: Grasp) -> Held: ...
            def cancel(self, task: Task, why: str) -> bool: ...

    A request without its method gets the default: an update lets the task begin anew, a cancel kills it. A blocking
    server hears requests while it waits, such as in ``task.sleep()``; one that replies later, between messages.
    """

    @abstractmethod
    def initiated(self, task: Task, goal: D) -> R | LaterReply[R] | Coroutine[Any, Any, R | LaterReply[R]]:
        """Do the task, and return its result; or ``task.reply_later()``, or be ``async def``."""

    def update(self, task: Task, goal: D) -> bool:
        """A client gives the running task a new goal: take it over, and return True; or False, which rejects it, or
        ``raise task.rejected("the reason")``. Should not take long.
        """
        raise NotImplementedError

    def cancel(self, task: Task, why: str) -> bool:
        """A client wants the task to end: leave all safe, and return True. The task then ends as cancelled: a blocking
        handler is woken with TaskKilled, a reply that is owed is not owed any more. Otherwise like ``update``.
        """
        raise NotImplementedError

    def requested(self, task: Task, request: TaskRequest) -> bool:
        """A client has taken another transition, of the task's own life cycle. Otherwise like ``update``."""
        raise NotImplementedError


def taken_by(message: Message[Any, Any], server: Server[Any, Any]) -> list[str]:
    """The transitions of clients for which a server has methods. Raises MisuseError if it is none."""
    if not isinstance(server, Server):
        hint = f": give {server.__name__}()" if isinstance(server, type) else ""
        raise MisuseError(f"serve(): {server!r:.60} is no Server{hint}")
    cycle, found = life_cycle_of(message), []
    for name in cycle.names(Party.CLIENT):
        method = _method_for(cycle, name)
        if getattr(type(server), method) is not getattr(Server, method):
            check_function(f"{type(server).__name__}.{method}", getattr(server, method), "(task, goal)")
            found.append(name)
    return found


def _method_for(cycle: LifeCycle, name: str) -> str:
    """The method to which a client's transition is given."""
    rows = [row for row in cycle.transitions if row.name == name and row.by is not Party.SERVER]
    if any(row.effect is Effect.NEW_GOAL for row in rows):
        return "update"
    return "cancel" if any(cycle.ends_on_request(row.target) for row in rows) else "requested"


class ServerHandler(Handler):
    """A server as a handler."""

    def __init__(self, message: Message[Any, Any], server: Server[Any, Any], known_as: HandlerFormat) -> None:
        super().__init__(message, server.initiated, known_as)
        self._server = server

    def task(self, connection: Connection, delivery: Deliver) -> Task:
        """A message to be handled; what clients ask of it is given to the server from now on."""
        task = super().task(connection, delivery)
        Conversation(self._server, task, self, connection, delivery)
        return task


class Conversation:
    """What clients ask of one task, and what its server says to that."""

    def __init__(
        self, server: Server[Any, Any], task: Task, handler: ServerHandler, connection: Connection, delivery: Deliver
    ) -> None:  # fmt: skip
        self._server = server
        self._task = task  # that the server has
        self._handler, self._delivery = handler, delivery
        self._connection = connection
        self._one, self._served = task.handled()
        self._served.is_conversing = True
        self._one.on_request += (self._hear_soon,)
        if self._one.requested:
            self._hear_soon()

    def _hear_soon(self) -> None:
        self._connection.waiting.callbacks.append(self._hear)

    def _hear(self) -> None:
        open_deliveries = self._connection.session.open_deliveries
        while open_deliveries.knows(self._one) and (request := self._served.take_new()) is not None:
            with working_on(self._one):
                self._answer(request)

    def _answer(self, request: TaskRequest) -> None:
        task, why = Handler.task(self._handler, self._connection, self._delivery), ""
        try:
            is_granted = self._ask(task, request)
            task.check_sent()
        except TaskKilled:
            return
        except Rejection as error:
            is_granted, why = False, str(error)
        except ORDINARY as error:
            self._connection.log.exception("%s: the server's answer to %s failed", type(self._server).__name__, request)
            is_granted, why = False, f"its handler failed: {type(error).__name__}: {error}"
        finally:
            task.returned()
        if is_granted:
            request.accept()
        elif self._served.can_reject:
            request.reject(why)
        else:
            request.accept()

    def _ask(self, task: Task, request: TaskRequest) -> bool:
        method = _method_for(self._served.life_cycle, request.transition)
        if method == "update":
            return self._server.update(task, request.goal)
        if method == "cancel":
            return self._server.cancel(task, request.why)
        return self._server.requested(task, request)
