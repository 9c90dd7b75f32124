"""Server: a handler of tasks as an object, with a method for each thing that clients may want; most
are optional.

Between messages, and while a handler waits, the thread of its resource gives requests to these
methods.
"""

from abc import ABC, abstractmethod
from collections.abc import Coroutine
from functools import partial
from typing import Any, Generic

from tca_module.checks import check_function
from tca_module.errors import ORDINARY, MisuseError, TaskKilled
from tca_module.following.followed_task import life_cycle_of
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import Rejection
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.task import Task
from tca_module.sending.task_requests import ServerState, TaskRequest
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

    A request without its method gets the default: an update lets the task begin anew, a cancel
    kills it. A blocking server hears requests while it waits, such as in ``task.sleep()``; one that
    replies later, between messages.
    """

    @abstractmethod
    def initiated(
        self, task: Task, goal: D
    ) -> R | LaterReply[R] | Coroutine[Any, Any, R | LaterReply[R]]:
        """Do the task, and return its result; or ``task.reply_later()``, or be ``async def``."""

    def update(self, task: Task, goal: D) -> bool:
        """A client gives the running task a new goal: take it over, and return True; or False,
        which rejects it, or ``raise task.rejected("the reason")``. Should not take long.
        """
        raise NotImplementedError

    def cancel(self, task: Task, why: str) -> bool:
        """A client wants the task to end: leave all safe, and return True. The task then ends as
        cancelled: a blocking handler is woken with TaskKilled, a reply that is owed is not owed any
        more. Otherwise like ``update``.
        """
        raise NotImplementedError

    def requested(self, task: Task, request: TaskRequest) -> bool:
        """A client has taken another transition, of the task's own life cycle. Otherwise like
        ``update``.
        """
        raise NotImplementedError


def taken_by(message: Message[Any, Any], server: Server[Any, Any]) -> list[str]:
    """The transitions of clients for which a server has methods. Raises MisuseError if it is
    none.
    """
    if not isinstance(server, Server):
        hint = f": give {server.__name__}()" if isinstance(server, type) else ""
        raise MisuseError(f"serve(): {server!r:.60} is no Server{hint}")
    cycle, found = life_cycle_of(message), []
    for name in cycle.names(Party.CLIENT):
        method = _method_for(cycle, name)
        if getattr(type(server), method) is not getattr(Server, method):
            check_function(
                f"{type(server).__name__}.{method}", getattr(server, method), "(task, goal)"
            )
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

    def __init__(
        self, message: Message[Any, Any], server: Server[Any, Any], known_as: HandlerFormat
    ) -> None:
        super().__init__(message, server.initiated, known_as)
        self._server = server

    def task(self, connection: Connection, delivery: Deliver) -> Task:
        """A message to be handled; what clients ask of it is given to the server from now on."""
        task = super().task(connection, delivery)
        served = task._served()  # noqa: SLF001 - not for users
        served.is_conversing = True

        def hear() -> None:
            while connection.session.open_deliveries.knows(served.delivery):
                if (request := served.take_new()) is None:
                    return
                with working_on(served.delivery):
                    self._decide(connection, delivery, served, request)

        hear_soon = partial(connection.waiting.callbacks.append, hear)
        served.delivery.on_request += (hear_soon,)
        if served.delivery.requested:
            hear_soon()
        return task

    def _decide(
        self, connection: Connection, delivery: Deliver, served: ServerState, request: TaskRequest
    ) -> None:
        """Say what the server says to a client's request."""
        task, why = super().task(connection, delivery), ""
        try:
            is_granted = self._ask(task, served, request)
            task.check_sent()
        except TaskKilled:
            return
        except Rejection as error:
            is_granted, why = False, str(error)
        except ORDINARY as error:
            connection.log.exception(
                "%s: the server's answer to %s failed", type(self._server).__name__, request
            )
            is_granted, why = False, f"its handler failed: {type(error).__name__}: {error}"
        finally:
            task.returned()
        if is_granted or not served.can_reject:
            request.accept()
        else:
            request.reject(why)

    def _ask(self, task: Task, served: ServerState, request: TaskRequest) -> bool:
        method = _method_for(served.life_cycle, request.transition)
        if method == "update":
            return self._server.update(task, request.goal)
        if method == "cancel":
            return self._server.cancel(task, request.why)
        return self._server.requested(task, request)
