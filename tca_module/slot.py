"""One place where messages are handled: a thread with a connection of its own."""

import logging
import threading
from collections.abc import Mapping

from tca_module.client import CentralAddress, open_connection
from tca_module.connection import Connection
from tca_module.errors import Stopped
from tca_module.handlers import HANDLER_ERROR, Handler
from tca_module.task import Task
from tca_wire.headers import Deliver, Fail, Hello


class Slot:
    """Handles one message at a time, from its start until *stop* is set. Handlers that run then are finished."""

    def __init__(
        self, central: CentralAddress, hello: Hello, patience: float, handlers: Mapping[str, Handler],
        stop: threading.Event,
    ) -> None:  # fmt: skip
        self.error: Exception | None = None  #: what ended the thread before its time
        self._central = central
        self._hello = hello
        self._patience = patience
        self._handlers = handlers
        self._stop = stop
        self._opened = threading.Event()
        self._connection: Connection | None = None
        self._log = logging.getLogger(f"tca.{hello.module}")
        self._thread = threading.Thread(target=self._run, name=f"{hello.resource} {hello.connection}", daemon=True)
        self._thread.start()

    def wait_until_open(self) -> None:
        """Wait until messages are handled. Raises what prevents it."""
        self._opened.wait()
        if self.error is not None:
            raise self.error

    def join(self) -> None:
        """Wait until the running handler, if any, has returned and the connection is closed; *stop* is set."""
        if self._connection is not None:
            self._connection.transport.wake()
        self._thread.join()

    def _run(self) -> None:
        try:
            is_stopped = self._stop.is_set
            self._connection = connection = open_connection(self._central, self._hello, self._patience, is_stopped)
            self._opened.set()
            connection.attend = self._attend
            connection.serve(is_stopped)
            connection.close()
        except Stopped:
            self._opened.set()
        except Exception as error:  # noqa: BLE001 - shown by the module's own thread
            self.error = error
            self._stop.set()
            self._opened.set()

    def _attend(self, delivery: Deliver, body: bytes) -> None:
        connection = self._connection
        assert connection is not None
        handler = self._handlers.get(delivery.message)
        if handler is None:
            connection.reply(Fail(delivery.delivery, "no handler", f"nothing here handles '{delivery.message}'"), b"")
            return
        task = Task(connection, delivery)
        reply, reply_body = handler.handle(task, delivery, body)
        task.returned()
        if isinstance(reply, Fail) and reply.failure == HANDLER_ERROR:
            self._log.error("handler %s failed: %s", handler.name, reply.text)
        connection.reply(reply, reply_body)
