"""Server: a handler of tasks as an object, with a method for each kind of client request.

Between messages, and while a handler waits, the thread of its resource calls these methods.
"""

from abc import ABC, abstractmethod
from collections.abc import Coroutine
from functools import partial
from typing import Any, Generic

from tca_module.checks import check_function, check_names
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
    """A handler of a message's tasks as an object, with a method for each kind of client request.

    Only ``initiated`` is required. A request without its method gets the default: an update
    restarts the task with the new goal, a cancel kills it. A blocking server answers requests while
    it waits, such as in ``task.sleep()``. A server that replies later answers them between
    messages.

    Example::

        class Grasping(Server[Grasp, Held]):
            def initiated(self, task: Task, goal: Grasp) -> Held: ...
            def cancel(self, task: Task, why: str) -> bool: ...

        module.serve(GRASP, Grasping())
    """

    @abstractmethod
    def initiated(
        self, task: Task, goal: D
    ) -> R | LaterReply[R] | Coroutine[Any, Any, R | LaterReply[R]]:
        """Carry out the task, and return its result. The method may be ``async def``.

        Args:
            task: the task.
            goal: the data of the task.

        Returns:
            The result of the task, or ``task.reply_later()``.
        """

    def update(self, task: Task, goal: D) -> bool:
        """Decide whether the running task pursues a client's new goal. Should not take long.

        Args:
            task: the task.
            goal: the new goal, of the same type as the task's data.

        Returns:
            True to adopt the goal. False rejects it; ``raise task.rejected("the reason")`` adds a
            reason.
        """
        raise NotImplementedError

    def cancel(self, task: Task, why: str) -> bool:
        """Decide whether the task ends, as a client wants. Should not take long.

        To end the task, leave everything safe and return True. The task then ends as cancelled. A
        blocking handler is woken with TaskKilled. A reply that is still owed is no longer needed.

        Args:
            task: the task.
            why: the client's reason.

        Returns:
            True to end the task. False rejects the request; ``raise task.rejected("the reason")``
            adds a reason.
        """
        raise NotImplementedError

    def requested(self, task: Task, request: TaskRequest) -> bool:
        """Decide about another transition of the task's own life cycle. Should not take long.

        Args:
            task: the task.
            request: the client's request, with its transition and data.

        Returns:
            True to grant the request. False rejects it; ``raise task.rejected("the reason")`` adds
            a reason.
        """
        raise NotImplementedError


def server_transitions(message: Message[Any, Any], server: Server[Any, Any]) -> list[str]:
    """Return the clients' transitions for which a server has methods.

    Raises MisuseError if *server* is not a Server.
    """
    if not isinstance(server, Server):
        hint = f": give {server.__name__}()" if isinstance(server, type) else ""
        raise MisuseError(f"serve(): {server!r:.60} is not a Server{hint}")
    check_names(type(server), ("initiated", "update", "cancel", "requested"))
    cycle, found = life_cycle_of(message), []
    for name in cycle.names(Party.CLIENT):
        method = _method_for(cycle, name)
        if getattr(type(server), method) is not getattr(Server, method):
            what = f"{type(server).__name__}.{method}"
            check_function(what, getattr(server, method), "(task, goal)")
            found.append(name)
    return found


def _method_for(cycle: LifeCycle, name: str) -> str:
    """Return the name of the method that decides about a client's transition."""
    rows = [row for row in cycle.transitions if row.name == name and row.by is not Party.SERVER]
    if any(row.effect is Effect.NEW_GOAL for row in rows):
        return "update"
    return "cancel" if any(cycle.ends_on_request(row.target) for row in rows) else "requested"


class ServerHandler(Handler):
    """A server as a handler."""

    def __init__(
        self, message: Message[Any, Any], server: Server[Any, Any], handler_format: HandlerFormat
    ) -> None:
        super().__init__(message, server.initiated, handler_format)
        self._server = server

    def task(self, connection: Connection, delivery: Deliver) -> Task:
        """Create the Task of a delivered message. The server answers the requests of clients."""
        task = super().task(connection, delivery)
        server_state = task._server_state()  # noqa: SLF001 - not for users
        server_state.has_request_methods = True

        def answer_requests() -> None:
            while connection.session.open_deliveries.is_open(server_state.open_delivery):
                if (request := server_state.pop_new_request()) is None:
                    return
                with working_on(server_state.open_delivery):
                    self._decide(connection, delivery, server_state, request)

        answer_soon = partial(connection.wait_loop.callbacks.append, answer_requests)
        server_state.open_delivery.on_request += (answer_soon,)
        if server_state.open_delivery.requested:
            answer_soon()
        return task

    def _decide(
        self,
        connection: Connection,
        delivery: Deliver,
        server_state: ServerState,
        request: TaskRequest,
    ) -> None:
        """Ask the server about a client's request, and send the answer."""
        task, why = super().task(connection, delivery), ""
        try:
            is_granted = self._ask(task, server_state, request)
            task.raise_send_errors()
        except TaskKilled:
            return
        except Rejection as error:
            is_granted, why = False, str(error)
        except ORDINARY as error:
            what = type(self._server).__name__
            connection.log.exception("%s: the server's answer to %s failed", what, request)
            is_granted, why = False, f"its handler failed: {type(error).__name__}: {error}"
        finally:
            task.handler_returned()
        if is_granted or not server_state.can_reject:
            request.accept()
        else:
            request.reject(why)

    def _ask(self, task: Task, server_state: ServerState, request: TaskRequest) -> bool:
        method = _method_for(server_state.life_cycle, request.transition)
        if method == "update":
            return self._server.update(task, request.goal)
        if method == "cancel":
            return self._server.cancel(task, request.why)
        return self._server.requested(task, request)
