"""Module: a program's handlers and their threads. One resource is one thread with its own
connection.
"""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Literal, TypeVar, Unpack, overload

from tca_module import checks
from tca_module.checks import check, check_class, check_function
from tca_module.errors import CentralLost, MisuseError, NotSent, Refused, Stopped
from tca_module.link.connection import LINGER, Connection
from tca_module.link.keepalive import TEND_PERIOD, KeepAlive
from tca_module.link.opening import CentralAddress, hello, open_connection
from tca_module.link.stop import Stop
from tca_module.link.waits import PATIENCE
from tca_module.log import log_of
from tca_module.sending.sender import Sender
from tca_module.serving.callbacks import Callback, Callbacks, HasFileno, ObservingFunction
from tca_module.serving.handler_options import (
    BUSY,
    HandlerOptions,
    ResourcePlan,
    WhenBusy,
    checked_format,
)
from tca_module.serving.handlers import Handler, HandlerDecorator, HandlerDecoratorWithoutData
from tca_module.serving.server import Server, ServerHandler, taken_by
from tca_module.serving.slot import CALLBACKS, Serving, Slot, Slots
from tca_wire.messages.declarations import Command, D, Goal, Message, R, TaskMessage
from tca_wire.packets.headers import WaitUntilHandled

_WARN_AFTER = 5.0  # seconds that a module waits for required messages without a word
_SIGNALS_PERIOD = (
    5.0  # seconds after which a signal is noticed that another thread got, as under a debugger
)

CallbackFunction = Callable[[Callback], object] | Callable[[], object]
F = TypeVar("F", bound=CallbackFunction)
O = TypeVar("O", bound=ObservingFunction)  # noqa: E741 - as F
Start = TypeVar("Start", bound=Callable[["Module"], object])


class Module(Sender):
    """A named program that handles messages.

    ::

        planner = Module("gait planner")

        @planner.handles(TAKE_STEPS)
        def take_steps(task: Task, arc: Arc) -> None: ...

        planner.run()

    With *requires*, it serves only when all of these messages are handled, by itself or others,
    also after a restart of central. Modules that require each other wait for ever: see 'tca
    status'.

    A running module is also a Sender under the root, for the thread that started it.
    """

    def __init__(
        self,
        name: str,
        central: CentralAddress = None,
        *,
        capacity: int = 1,
        requires: Collection[Message[Any, Any]] = (),
    ) -> None:
        super().__init__()
        check("Module()", checks.NAME, name=name)
        what = f"module '{name}'"
        check(what, checks.CENTRAL, central=central)
        check(what, checks.CAPACITY, capacity=capacity)
        check(what, checks.MESSAGES, requires=requires)
        self._required = list(requires)
        self.name = name
        self.central = central
        self._resources = {name: ResourcePlan(capacity)}
        self._handlers: dict[str, Handler] = {}
        self._first: list[Callable[[Module], object]] = []
        self._link: Connection | None = None
        self._slots = Slots(name)
        self._stop = Stop()
        self._keep_alive: KeepAlive | None = None
        self._linger = LINGER
        self._log = log_of(name)

    def __repr__(self) -> str:
        return f"Module({self.name!r})"

    # --- declaring --------------------------------------------------------------------------------

    def resource(
        self,
        name: str,
        capacity: int = 1,
        *,
        hung: Literal["wait", "replace"] = "wait",
        hung_after: float = 5.0,
        when_busy: WhenBusy = "queue",
    ) -> str:
        """Declare a part of the module that handles at most *capacity* messages at a time, each in
        its own thread. Handlers choose it with ``resource=``; the others use the module's own
        resource, which this may name, too.

        With ``hung="replace"`` a handler that does not return *hung_after* seconds after its task
        was killed, or its sender gave up, is left behind: another thread takes its place. Without
        it the place stays taken.

        *when_busy* says what becomes of a task that would have to wait for it, unless its handler,
        declared after this, says so: see HandlerOptions.
        """
        self._check_not_running("resource()")
        check("resource()", checks.NAME, name=name)
        check(f"resource '{name}'", checks.CAPACITY, capacity=capacity)
        check(f"resource '{name}'", checks.HUNG, hung=hung)
        check(f"resource '{name}'", checks.DURATION, hung_after=hung_after)
        check(f"resource '{name}'", BUSY, when_busy=when_busy)
        self._resources[name] = ResourcePlan(
            capacity, hung_after if hung == "replace" else 0.0, when_busy, is_declared=True
        )
        return name

    @overload
    def handles(
        self, message: Message[None, R], **options: Unpack[HandlerOptions]
    ) -> HandlerDecoratorWithoutData[R]: ...
    @overload
    def handles(
        self, message: Message[D, R], **options: Unpack[HandlerOptions]
    ) -> HandlerDecorator[D, R]: ...
    def handles(self, message: Message[Any, Any], **options: Unpack[HandlerOptions]) -> Any:
        """Declare the decorated function, plain or ``async def``, as this module's handler of
        *message*.

        The newest module that declares a handler gets the messages; modules that name the same
        *pool* share them.
        """
        self._check_not_running("handles()")
        known_as = checked_format(message, options, self.name, self._resources)

        def declare(function: Callable[..., Any]) -> Callable[..., Any]:
            self._add(Handler(message, function, known_as))
            return function

        return declare

    def serve(
        self, message: TaskMessage[D, R], server: Server[D, R], **options: Unpack[HandlerOptions]
    ) -> None:
        """Declare a Server as this module's handler of the tasks of *message*. Its methods say what
        it takes; otherwise like ``handles``.
        """
        self._check_not_running("serve()")
        check_class(message, Goal, Command, call="serve")
        if "takes" in options:
            raise MisuseError(
                f"serve() of {message.title}: the methods of the Server say what it takes, not takes="
            )
        options["takes"] = [
            name for name in taken_by(message, server) if name not in options.get("refuses", ())
        ]
        self._add(
            ServerHandler(
                message, server, checked_format(message, options, self.name, self._resources)
            )
        )

    def _add(self, handler: Handler) -> None:
        name = handler.message.name
        if known := self._handlers.get(name):
            msg = f"module '{self.name}' handles '{name}' already, in {known.name}: one handler a message"
            raise MisuseError(msg)
        self._handlers[name] = handler
        self._resources.setdefault(handler.resource, ResourcePlan())

    def at_start(self, function: Start) -> Start:
        """Have the decorated function called with the module once it has joined, before it gets any
        message: to attach exception handlers and wiretaps. An error in it ends the module. It is
        not called again when central is restarted: what it attached to messages and to the root is
        attached anew by itself.
        """
        self._check_not_running("at_start()")
        check_function("at_start()", function, "(module)")
        self._first.append(function)
        return function

    # --- callbacks --------------------------------------------------------------------------------

    def every(self, period: float, *, resource: str | None = None) -> Callable[[F], F]:
        """Have the decorated function called every *period* seconds while the module runs, first
        after one period, without drift; missed calls are skipped.

        The function takes the Callback, to send with and to ``cancel()``, or nothing. A parameter
        with a default keeps it: ``lambda n=n: ...``. The thread of *resource* calls it between
        messages; by default a thread for callbacks alone. Errors in it are logged.
        """
        check("every()", checks.NAME_OR_NONE, resource=resource)

        def declare(function: F) -> F:
            self._called_by("every()", resource).every(period, function)
            return function

        return declare

    def observes(
        self,
        message: Message[Any, Any] | None = None,
        *,
        states: Collection[str] = (),
        resource: str | None = None,
    ) -> Callable[[O], O]:
        """Have the decorated function called with a Sender and each change of state of the tasks of
        *message* (None: of all tasks), or with the change alone: first with how each living one
        stands (``is_late``). With *states*, only with changes to one of these. Neither their
        senders nor their handlers need know of it.

        ::

            @head.observes(GRASP, states=["running"])
            def look(sender: Sender, change: Change) -> None:
                sender.inform(GAZE, change.goal.place)

        The thread of *resource* calls it between messages; by default the one for callbacks. Errors
        in it are logged.
        """
        self._check_not_running("observes()")
        check("observes()", checks.NAME_OR_NONE, resource=resource)

        def declare(function: O) -> O:
            self._called_by("observes()", resource).observe(message, states, function)
            return function

        return declare

    def after(
        self, delay: float, function: CallbackFunction, *, resource: str | None = None
    ) -> Callback:
        """Have a function called once, *delay* seconds from now or from the module's start;
        otherwise like ``every``. May be called at any time, from any thread.
        """
        return self._called_by("after()", resource).after(delay, function)

    def on_readable(
        self, source: int | HasFileno, function: CallbackFunction, *, resource: str | None = None
    ) -> Callback:
        """Have a function called whenever a socket, pipe or other file (or its number) has
        something to read; otherwise like ``after``. The function reads it, or is called again at
        once. ``cancel()`` it before closing the file.
        """
        return self._called_by("on_readable()", resource).on_readable(source, function)

    def _called_by(self, call: str, resource: str | None) -> Callbacks:
        check(call, checks.NAME_OR_NONE, resource=resource)
        named = resource or CALLBACKS
        if self._link is None:
            self._resources.setdefault(named, ResourcePlan())
        else:
            self._link.check_process()
        return self._slots.callbacks(named)

    def _check_not_running(self, call: str) -> None:
        if self._link is not None:
            raise MisuseError(
                f"{call} of module '{self.name}' comes too late: declare before run()"
            )

    # --- running ----------------------------------------------------------------------------------

    def run(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> None:
        """Handle messages until Ctrl-C or SIGTERM; a second one leaves at once.

        Running handlers are told and waited for: ``task.cancelled`` is true, waits raise Stopped,
            coroutines get
        CancelledError. Handlers that were told fail with "module lost"; those that wait for nothing
        just finish.

        Raises CentralLost if no central answers within *patience* seconds. If central goes away
        later, waits for it; with *reconnect* False, raises CentralLost. The end waits until all
        that was sent has arrived, at most *linger* seconds; it raises NotSent if something may not
        have.
        """
        running = self.running(patience=patience, reconnect=reconnect, linger=linger)
        with _stopped_by_signals(self._stop), contextlib.suppress(Stopped), running:
            while not self._stop.wait(_SIGNALS_PERIOD):
                pass

    @contextmanager
    def running(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> Iterator["Module"]:
        """Handle messages in the background while the block lasts; otherwise like ``run``.

        The module may end earlier: by ``stop``, or by an error in a handler that is no Exception,
            such as
        KeyboardInterrupt. The log says so at once, and the end of the block raises it. (SystemExit
        and asyncio.CancelledError are handler errors.)
        """
        if self._link is not None:
            msg = f"module '{self.name}' runs already"
            if self._stop.is_set():
                msg = f"module '{self.name}' ends: it can begin again when its 'with module.running():' has been left"
            raise MisuseError(msg)
        self._stop.clear()
        try:
            self._begin(patience, linger, reconnect=reconnect)
        except CentralLost as error:
            raise CentralLost(f"module '{self.name}': {error}") from None
        try:
            yield self
        except BaseException as error:
            for earlier in self._leave(error):
                if isinstance(error, Exception) and not isinstance(earlier, Exception):
                    raise earlier from error  # one that must be noticed
                ended = f"module '{self.name}' had ended before: {type(earlier).__name__}: "
                error.add_note(f"{'' if isinstance(earlier, NotSent) else ended}{earlier}")
            raise
        for earlier in self._leave():
            raise earlier

    def stop(self) -> None:
        """Have the module end: ``run`` returns. May be called from any thread.

        A ``running`` block goes on without handlers and callbacks, and can still send; messages go
        to the modules that handled them before.
        """
        self._stop.set()

    @property
    def stopping(self) -> bool:
        """Whether the module is about to end."""
        return self._stop.is_set()

    def _begin(self, patience: float, linger: float, *, reconnect: bool) -> None:
        check(f"module '{self.name}'", checks.PATIENCE, patience=patience, linger=linger)
        self._linger = linger
        check(f"module '{self.name}'", checks.FLAG, reconnect=reconnect)
        greeting = hello(self.name)
        self._link = link = open_connection(self.central, greeting, patience, self._stop.is_set)
        link.root_sender = self
        if (known := link.session.module) != self.name:
            text = f"another module '{self.name}' runs, so central calls this one '{known}'"
            self._log.warning(
                "%s: give each a name of its own, unless the newer one replaces the older", text
            )
        link.session.replace_slot = self._slots.replace
        try:
            self._wait_for_required(link)
            for function in self._first:
                function(self)
            handlers = self._handlers.values()
            messages, formats = [one.message for one in handlers], [one.format for one in handlers]
            link.declare(*messages, handlers=formats, is_ready=True)
            attachments = link.session.attachments
            serving = Serving(
                self.central, patience, linger, self._handlers, self._stop, attachments
            )
            self._open_slots(greeting.incarnation, serving)
        except BaseException:
            self._leave()
            raise
        self._keep_alive = KeepAlive(link, self._stop, reconnect=reconnect)

    def _wait_for_required(self, link: Connection) -> None:
        required = [message for message in self._required if message.name not in self._handlers]
        if not required:
            return
        link.declare(*required)
        link.session.redeclaration.required = [message.name for message in required]
        wanted = WaitUntilHandled(0, [message.name for message in required], list(self._handlers))
        request, since, warned = link.request(wanted, wants_answer=True), time.monotonic(), False
        while not link.wait(request, TEND_PERIOD, "the wait for required messages"):
            if self._stop.is_set():
                link.abandon(request)
                raise Stopped(
                    f"module '{self.name}' was told to end while it waited for what it requires"
                )
            while request.answers:
                warned = True
                self._log.warning("%s", request.answers.popleft()[0].text)
            if not warned and time.monotonic() - since > _WARN_AFTER:
                warned = True
                names = checks.quoted(message.name for message in required)
                self._log.warning(
                    "waits for handlers of %s, which it requires; see 'tca messages'", names
                )

    def _open_slots(self, incarnation: str, serving: Serving) -> None:
        def open_slot(number: int, resource: str, callbacks: Callbacks) -> Slot:
            greeting = hello(
                self.name, number, resource, incarnation, self._resources[resource].hung_after
            )
            slot = Slot(serving, greeting, callbacks)
            if getattr(self.central, "is_stepped", False):
                slot.opened.wait()  # in the declared order: so the same test has the same transcript
            return slot

        self._resources.setdefault(
            CALLBACKS, ResourcePlan()
        )  # after() may have been called while required messages were awaited
        used = {
            handler.resource for handler in self._handlers.values()
        } | self._slots.with_callbacks
        for name in sorted(
            name for name, plan in self._resources.items() if plan.is_declared and name not in used
        ):
            text = "resource '%s' of module '%s' has no handler, so nothing can lock it: declare one with resource='%s'"
            self._log.warning(text, name, self.name, name)
        self._slots.open(
            [name for name in self._resources if name in used], self._resources, open_slot
        )

    def _leave(self, why: BaseException | None = None) -> list[BaseException]:
        """Take nothing new, finish what runs, say goodbye; the errors that ended the module
        early.
        """
        link = self._link
        assert link is not None
        if link.is_inherited:
            return []  # the process that began says goodbye
        if self._keep_alive is not None:
            self._keep_alive.end()
        self._stop.set()
        link.leave()
        errors = self._slots.close(why)
        is_in_vain = any(isinstance(error, NotSent) for error in errors)
        try:
            link.close(0.0 if is_in_vain else self._linger, link.lost)
        except (CentralLost, Refused) as error:
            errors.append(error)
        if self._keep_alive is not None and self._keep_alive.error is not None:
            errors.insert(0, self._keep_alive.error)
        self._link, self._keep_alive = None, None
        return errors

    def _connection(self) -> Connection:
        if self._link is None:
            msg = f"module '{self.name}' does not run: send within 'with module.running():' or from a handler"
            raise MisuseError(msg)
        self._link.check_thread(f"module '{self.name}'", "runs it")
        return self._link


@contextmanager
def _stopped_by_signals(stop: Stop) -> Iterator[None]:
    """The first SIGINT or SIGTERM sets *stop*, the second ends the process at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_signal(*_: Any) -> None:
        stop.note()
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, on_signal) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
