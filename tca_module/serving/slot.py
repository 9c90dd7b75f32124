"""The threads of a module: as many per resource as its capacity.

One of them calls the resource's callbacks.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple
from weakref import WeakSet

from msgspec.structs import replace

from tca_module.errors import MisuseError, NotSent, Stopped
from tca_module.link.connection import Connection
from tca_module.link.opening import CentralAddress, open_connection
from tca_module.link.stop import Stop
from tca_module.log import log_of
from tca_module.sending.handler_errors import module_end_failure
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.sender import Sender
from tca_module.sending.task import Task
from tca_module.serving.callbacks import Callbacks
from tca_module.serving.event_loop import EventLoop
from tca_module.serving.handler_options import ResourcePlan
from tca_module.serving.handlers import Answer, Handler
from tca_module.session.lasting_attachments import LastingAttachments
from tca_module.session.open_deliveries import working_on
from tca_module.sockets.transport import wait_for_files
from tca_wire.messages.failures import HANDLER_ERROR, MODULE_LOST
from tca_wire.packets.headers import Deliver, Fail, Hello, Reply, Unregister

CALLBACKS = "callbacks"
"""The resource whose thread calls the callbacks that name no resource."""

# seconds that handlers have to end before the log says that they are waited for
_WARN_AFTER = 1.0


class Serving(NamedTuple):
    """The common settings of a running module's slots."""

    central: CentralAddress
    patience: float
    linger: float
    handlers: Mapping[str, Handler]
    stop: Stop
    attachments: LastingAttachments
    """The module's attachments. Its first connection reattaches them after central's restart."""


class Slot:
    """A thread with a connection of its own that handles one message at a time.

    It runs until the module stops.
    """

    def __init__(self, serving: Serving, hello: Hello, callbacks: Callbacks) -> None:
        self.error: BaseException | None = None  #: the error that ended the thread early
        self.handling = ""  #: the message whose handler runs
        self.is_replaced = False  #: the handler hung, and another slot has taken this slot's place
        self.callbacks = callbacks  #: the callbacks that the slot's thread calls
        self.ready = threading.Event()  #: set when the slot handles messages, or has an *error*
        self._serving = serving
        #: the greeting, which names the slot's resource and the number of its connection
        self.hello = hello
        self._connection: Connection  # set when the thread has opened it
        self._loop: EventLoop | None = None  #: created when first needed
        #: replies that handlers owe; weak references, so that a dropped LaterReply fails
        self._owed = WeakSet[LaterReply[Any]]()
        self._log = log_of(hello.module)
        name = f"{hello.resource} {hello.connection}"
        self.thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        serving = self._serving
        try:
            self._serve(
                open_connection(
                    serving.central,
                    self.hello,
                    serving.patience,
                    serving.stop.is_set,
                    serving.attachments,
                )
            )
        except Stopped:
            self.ready.set()
        except BaseException as error:  # noqa: BLE001 - raised by the module's own thread
            if self.is_replaced:
                return
            self.error = error
            self._serving.stop.set()
            self.ready.set()

    def _serve(self, connection: Connection) -> None:
        self._connection = connection
        self._serving.stop.on_set(connection.transport.wake)
        connection.wait_loop.handle_delivery = self._handle_delivery
        connection.session.open_deliveries.is_ending = self._is_over
        connection.root_sender = Sender(connection=lambda: connection)
        self.callbacks.begin(connection)
        self.ready.set()
        with contextlib.ExitStack() as stack:
            stack.callback(connection.drop)  # for the case that the goodbye itself fails
            try:
                connection.serve(self._is_over, self._idle)
            except BaseException as error:
                if self.is_replaced:
                    return
                self._serving.stop.set()
                text = f"module '{self.hello.module}' ends and handles no more messages"
                self._log.error("%s: %s", text, type(error).__name__, exc_info=error)
                # From now on, senders find the handlers of other modules.
                connection.post(Unregister(0, []), b"")
                stack.callback(self._close_connection, connection, error)
                raise
            finally:
                if not self.is_replaced:
                    self.callbacks.end()
                if self._loop is not None:
                    self._loop.close()
            if not self.is_replaced:
                self._close_connection(connection)

    def _is_over(self) -> bool:
        return self.is_replaced or self._serving.stop.is_set()

    def _close_connection(self, connection: Connection, error: BaseException | None = None) -> None:
        connection.crash = self._serving.stop.crash
        connection.return_prefetched()
        connection.run_requested_calls()
        for later in list(self._owed):
            later.module_ends()
        if error is not None:
            for delivery in connection.session.open_deliveries.begun:
                connection.reply(*module_end_failure(delivery, error))
        try:
            connection.close(self._serving.linger, connection.session.lost)
        except NotSent as lost:
            if error is None:
                raise
            self._log.error("%s", lost)

    def _idle(self, seconds: float) -> bool:
        """Call one callback, or wait for work; return False if only central can bring work."""
        callbacks = self.callbacks
        if callbacks:
            with self._connection.wait_loop.unlocked():
                if callbacks.call_one():
                    return True
        if self._loop is None and not callbacks:
            return False
        patience, files = callbacks.seconds_until_due(seconds), callbacks.files
        if self._loop is not None:
            ready = self._loop.wait(patience, files)
        else:
            ready = wait_for_files(self._connection.transport, patience, files)
        callbacks.queue_due(ready)
        return True

    def _handle_delivery(self, delivery: Deliver, body: bytes, *, in_loop: bool = False) -> None:
        """Handle a message until its handler ends.

        With *in_loop*, an ``async def`` handler runs beside the coroutine that is awaiting.
        """
        connection, loop = self._connection, self._loop
        handler = self._serving.handlers.get(delivery.message)
        if handler is None:
            text = f"nothing here handles '{delivery.message}'"
            connection.reply(Fail(delivery.delivery, "no handler", text), b"")
            return
        task, self.handling = handler.task(connection, delivery), delivery.message
        begun = connection.session.open_deliveries.begin(delivery.delivery, repr(task))
        if not handler.is_async:
            with working_on(begun):
                self._finish(handler, task, handler.handle(task, body))
        elif loop is not None and in_loop:
            loop.start(begun, self._handle_async(handler, task, body))
        elif loop is not None and loop.is_running:
            text = (
                f"handler {handler.name} is 'async def', but a blocking call of the same thread"
                " blocks its event loop: await that call with task.query_send(...)"
            )
            self._finish(handler, task, (Fail(delivery.delivery, HANDLER_ERROR, text), b""))
        else:
            if loop is None:
                handle = partial(self._handle_delivery, in_loop=True)
                loop = self._loop = EventLoop(connection, handle)
            # The reply leaves when the loop has stopped, so that the next message is not handled
            # inside the handling of this message.
            answer = loop.run(begun, handler.handle_async(task, body))
            with working_on(begun):
                self._finish(handler, task, answer)

    async def _handle_async(self, handler: Handler, task: Task, body: bytes) -> None:
        self._finish(handler, task, await handler.handle_async(task, body))

    def _finish(self, handler: Handler, task: Task, answer: Answer) -> None:
        """Send the outcome of a handler to central, or register the reply that it owes."""
        if task.later is not None and not isinstance(answer, LaterReply):
            # The handler promised a later reply, and failed. Intermediate results that other
            # threads have reported must be sent before that failure.
            self._connection.run_requested_calls()
        task.handler_returned()
        if self.is_replaced:
            text = "has returned after all: another thread has taken its place"
            self._log.warning("handler %s %s", handler.name, text)
            return
        if isinstance(answer, LaterReply):
            self._owed.add(answer)
            answer.handler_returned()
            return
        header, body = answer
        open_deliveries = self._connection.session.open_deliveries
        # A handler that was woken because its module ends may have stopped halfway.
        if isinstance(header, Reply) and open_deliveries.was_woken_to_end(task.delivery):
            text = f"its module ended while {handler.name} ran"
            header, body = Fail(task.delivery, MODULE_LOST, text), b""
        if isinstance(header, Fail) and header.failure == HANDLER_ERROR:
            self._log.error("handler %s failed: %s", handler.name, header.text)
        if isinstance(header, Reply):
            header = replace(header, took=self._connection.now() - task.began)
        self._connection.reply(header, body)


OpenSlot = Callable[[int, str, Callbacks], Slot]
"""Opens the slot of that number (from 1) for a resource."""


class Slots:
    """The slots of a module while it runs, and its callbacks at any time."""

    def __init__(self, module: str) -> None:
        self._module = module
        self._log = log_of(module)
        self._callbacks: dict[str, Callbacks] = {}  #: resource -> callbacks of its thread
        self._lock = threading.Lock()
        self._slots: list[Slot] = []
        self._count = 0  #: number of slots that were opened in this run
        self.left_behind = 0  #: number of slots whose handlers hung
        self._open_slot: OpenSlot | None = None  #: set while the module runs

    def open(
        self, resources: Iterable[str], plans: Mapping[str, ResourcePlan], open_slot: OpenSlot
    ) -> None:
        """Open the slots of *resources*, and wait until they handle messages.

        Raises the error that prevents a slot from handling messages.
        """
        with self._lock:
            self._open_slot = open_slot
            for resource in resources:
                for _ in range(plans[resource].capacity):
                    self._open(resource, open_slot)
            opened = list(self._slots)
        for slot in opened:
            slot.ready.wait()
            if slot.error is not None:
                raise slot.error

    def close(self, why: BaseException | None) -> list[BaseException]:
        """Wait until all slots have ended; return the errors that ended slots early.

        A long wait is logged. *why*: the error because of which the module ends, if any.
        """
        with self._lock:
            self._open_slot = None
        warn_at = time.monotonic() + _WARN_AFTER
        for slot in self._slots:
            slot.thread.join(max(0.0, warn_at - time.monotonic()))
            if slot.thread.is_alive():
                self._log.warning(
                    "module '%s' ends%s, and waits for its handler of '%s' to return"
                    " (it can check task.cancelled)",
                    self._module,
                    f" ({type(why).__name__}: {why})" if why is not None else "",
                    slot.handling,
                )
                slot.thread.join()
        errors = [slot.error for slot in self._slots if slot.error is not None]
        self._slots.clear()
        self._count = 0
        return errors

    @property
    def with_callbacks(self) -> set[str]:
        """The resources whose threads have callbacks to call."""
        return {resource for resource, callbacks in self._callbacks.items() if callbacks}

    def callbacks(self, resource: str) -> Callbacks:
        """Return the callbacks of a resource's thread.

        If the module runs, the resource must have a thread, or this raises MisuseError. Only the
        thread of ``CALLBACKS`` is started here.
        """
        with self._lock:
            if self._open_slot is not None and not self._has_thread(resource):
                if resource != CALLBACKS:
                    what = f"resource '{resource}' of module '{self._module}' has no thread"
                    raise MisuseError(f"{what}: before run(), declare what it handles or calls")
                self._open(resource, self._open_slot)
            return self._callbacks.setdefault(resource, Callbacks(self._module))

    def _has_thread(self, resource: str) -> bool:
        return any(slot.hello.resource == resource for slot in self._slots)

    def _open(self, resource: str, open_slot: OpenSlot) -> None:
        callbacks = Callbacks(self._module)
        if not self._has_thread(resource):  # only the first thread of a resource calls callbacks
            callbacks = self._callbacks.setdefault(resource, callbacks)
        self._add(resource, callbacks, open_slot)

    def _add(self, resource: str, callbacks: Callbacks, open_slot: OpenSlot) -> None:
        self._count += 1
        self._slots.append(open_slot(self._count, resource, callbacks))

    def replace(self, number: int, why: str) -> None:
        """Leave a slot behind whose handler hangs, and open another one in its place."""
        with self._lock:
            hung = next((slot for slot in self._slots if slot.hello.connection == number), None)
            if hung is None or self._open_slot is None:
                return
            hung.is_replaced = True
            self._slots.remove(hung)
            self.left_behind += 1
            text = f"another thread takes its place (left behind: {self.left_behind})"
            self._log.warning("module '%s': %s; %s", self._module, why, text)
            self._add(hung.hello.resource, hung.callbacks, self._open_slot)
