"""One place where messages are handled: a thread with a connection of its own."""

import contextlib
import logging
import threading
from collections.abc import Mapping
from typing import Any

from tca_module.errors import Stopped
from tca_module.link.connection import Connection
from tca_module.link.opening import CentralAddress, open_connection
from tca_module.sending.handler_errors import module_ended
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.sender import Sender
from tca_module.sending.task import Task
from tca_module.serving.callbacks import Callbacks
from tca_module.serving.event_loop import EventLoop
from tca_module.serving.handlers import Answer, Handler
from tca_module.session.lasting_attachments import LastingAttachments
from tca_module.session.open_deliveries import working_on
from tca_module.sockets.transport import wait
from tca_wire.messages.failures import HANDLER_ERROR, MODULE_LOST
from tca_wire.packets.headers import Deliver, Fail, Hello, Reply, Unregister


class Slot:
    """A thread with a connection of its own that handles one message at a time, until *stop* is set. Handlers that run
    then are told once, and waited for.
    """

    def __init__(
        self, central: CentralAddress, hello: Hello, patience: float, handlers: Mapping[str, Handler],
        callbacks: Callbacks, stop: threading.Event, attachments: LastingAttachments,
    ) -> None:  # fmt: skip
        self.error: BaseException | None = None  #: what ended the thread before its time
        self.handling = ""  #: the message whose handler runs
        self._central = central
        self._hello = hello
        self._patience = patience
        self._handlers = handlers
        self._callbacks = callbacks
        self._stop = stop
        self._attachments = attachments  #: of the module, which its first connection attaches anew
        self._opened = threading.Event()
        self._connection: Connection | None = None
        self._loop: EventLoop | None = None  #: made when it is first needed
        self._owed: list[LaterReply[Any]] = []  #: answers that handlers left to others
        self._log = logging.getLogger(f"tca.{hello.module}")
        self._thread = threading.Thread(target=self._run, name=f"{hello.resource} {hello.connection}", daemon=True)
        self._thread.start()

    def wait_until_open(self) -> None:
        """Wait until messages are handled. Raises what prevents it."""
        self._opened.wait()
        if self.error is not None:
            raise self.error

    def join(self, timeout: float | None = None) -> bool:
        """Wait, at most *timeout* seconds, until the thread has ended; whether it has. *stop* is set."""
        if self._connection is not None:
            self._connection.transport.wake()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        handlers = [one for one in self._handlers.values() if one.resource == self._hello.resource]
        direct = [handler.message for handler in handlers if handler.direct]
        try:
            stopped, attachments = self._stop.is_set, self._attachments
            self._serve(open_connection(self._central, self._hello, self._patience, stopped, direct, attachments))
        except Stopped:
            self._opened.set()
        except BaseException as error:  # noqa: BLE001 - shown by the module's own thread
            self.error = error
            self._stop.set()
            self._opened.set()

    def _serve(self, connection: Connection) -> None:
        self._connection = connection
        connection.handle_delivery = self._attend
        connection.session.open_deliveries.is_ending = self._stop.is_set
        connection.root_sender = RootSender(connection)
        self._callbacks.begin(connection)
        self._opened.set()
        with contextlib.ExitStack() as stack:
            stack.callback(connection.drop)  # without goodbye if even that has an error
            try:
                connection.serve(self._stop.is_set, self._idle)
            except BaseException as error:
                self._end_module(connection, error)
                stack.callback(self._say_goodbye, connection, error)
                raise
            finally:
                self._callbacks.end()
                if self._loop is not None:
                    self._loop.close()
            self._say_goodbye(connection)

    def _end_module(self, connection: Connection, error: BaseException) -> None:
        """An error ends the module. Senders whose messages fail by it then find the handlers of other modules."""
        self._stop.set()
        what, module = type(error).__name__, self._hello.module
        self._log.error("module '%s' ends, and handles nothing any more: %s", module, what, exc_info=error)
        connection.post(Unregister(0, []), b"")

    def _say_goodbye(self, connection: Connection, error: BaseException | None = None) -> None:
        while connection.session.news:  # answers of others, perhaps
            connection.session.news.popleft()()
        for later in self._owed:
            later.module_ends()
        if error is not None:
            for delivery in connection.session.open_deliveries.begun:
                connection.reply(*module_ended(delivery, error))
        connection.close()

    # --- between messages ------------------------------------------------------------------------------------------

    def _idle(self, seconds: float) -> bool:
        """Call one callback, or wait for something to do; False if only central can bring that."""
        callbacks = self._callbacks
        if callbacks.call_one():
            return True
        if self._loop is None and not callbacks:
            return False
        assert self._connection is not None
        patience, files = callbacks.patience(seconds), callbacks.files
        if self._loop is not None:
            ready = self._loop.wait(patience, files)
        else:
            ready = wait(self._connection.transport, patience, files)
        callbacks.found(ready)
        return True

    # --- messages --------------------------------------------------------------------------------------------------

    def _attend(self, delivery: Deliver, body: bytes) -> None:
        """Handle a message, to the end of its handler."""
        connection = self._connection
        assert connection is not None
        handler = self._handlers.get(delivery.message)
        if handler is None:
            connection.reply(Fail(delivery.delivery, "no handler", f"nothing here handles '{delivery.message}'"), b"")
            return
        task, self.handling = Task(connection, delivery, handler.message), delivery.message
        begun = connection.session.open_deliveries.begin(delivery.delivery, repr(task))
        if not handler.is_async:
            with working_on(begun):
                self._end(handler, task, handler.handle(task, body))
        elif self._loop is not None and self._loop.is_running:
            text = f"handler {handler.name} is 'async def', and its event loop is blocked by a call of its own thread"
            hint = "await that one: task.query_send(...)"
            self._end(handler, task, (Fail(delivery.delivery, HANDLER_ERROR, f"{text}: {hint}"), b""))
        else:
            # The reply leaves when the loop has stopped: the next message must not be handled inside of this one's.
            answer = self._event_loop(connection).run(begun, handler.handle_async(task, body))
            with working_on(begun):
                self._end(handler, task, answer)

    def _attend_in_loop(self, delivery: Deliver, body: bytes) -> None:
        """Handle a message beside a coroutine that awaits."""
        handler = self._handlers.get(delivery.message)
        if handler is None or not handler.is_async:
            self._attend(delivery, body)
            return
        assert self._connection is not None
        assert self._loop is not None
        task = Task(self._connection, delivery, handler.message)
        begun = self._connection.session.open_deliveries.begin(delivery.delivery, repr(task))
        self._loop.start(begun, self._attend_async(handler, task, body))

    async def _attend_async(self, handler: Handler, task: Task, body: bytes) -> None:
        self._end(handler, task, await handler.handle_async(task, body))

    def _event_loop(self, connection: Connection) -> EventLoop:
        if self._loop is None:
            self._loop = EventLoop(connection, self._attend_in_loop)
        return self._loop

    def _end(self, handler: Handler, task: Task, answer: Answer) -> None:
        """A handler has returned: tell central, or see that somebody will."""
        assert self._connection is not None
        task.returned()
        if isinstance(answer, LaterReply):
            self._owed = [*(later for later in self._owed if later.is_open), answer]
            answer.returned()
            return
        header, body = answer
        if isinstance(header, Reply) and self._connection.session.open_deliveries.was_told_to_end(task.delivery):
            header, body = Fail(task.delivery, MODULE_LOST, f"its module ended while {handler.name} ran"), b""
        if isinstance(header, Fail) and header.failure == HANDLER_ERROR:
            self._log.error("handler %s failed: %s", handler.name, header.text)
        self._connection.reply(header, body)


class RootSender(Sender):
    """Sends under the root, for callbacks in a slot's thread."""

    def __init__(self, connection: Connection) -> None:
        super().__init__()
        self._link = connection

    def _connection(self) -> Connection:
        return self._link
