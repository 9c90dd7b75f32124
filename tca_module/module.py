"""Module: the handlers of a program, and the threads that call them.

Each slot of a resource is one thread with its own connection to central.
"""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Literal, TypeVar, Unpack, overload

from tca_module import checks
from tca_module.asynchronous.loop_module import LoopModule
from tca_module.checks import (
    block,
    check,
    check_class,
    check_decorator,
    check_function,
    with_options,
)
from tca_module.errors import CentralLost, MisuseError, NotSent, Refused, Stopped
from tca_module.link.connection import LINGER, Connection
from tca_module.link.keepalive import CHECK_PERIOD, KeepAlive
from tca_module.link.opening import CentralAddress, hello, open_connection
from tca_module.link.stop import Stop
from tca_module.link.waits import PATIENCE
from tca_module.log import log_of
from tca_module.sending.handler_errors import crash_text
from tca_module.serving.callbacks import Callbacks
from tca_module.serving.handler_options import (
    BUSY,
    HandlerOptions,
    ResourcePlan,
    WhenBusy,
    checked_format,
)
from tca_module.serving.handlers import Handler, HandlerDecorator, HandlerDecoratorWithoutData
from tca_module.serving.server import Server, ServerHandler, server_transitions
from tca_module.serving.slot import CALLBACKS, Serving, Slot, Slots
from tca_wire.messages.declarations import Command, D, Goal, Message, R, TaskMessage
from tca_wire.packets.headers import WaitUntilHandled

_WARN_AFTER = 5.0  # seconds of a wait for required messages before the log warns

# Seconds between two wake-ups of the main thread. Only the main thread runs signal handlers. If
# another thread has received the signal, as under a debugger, only a wake-up runs the handler.
_SIGNALS_PERIOD = 5.0

Start = TypeVar("Start", bound=Callable[["Module"], object])


class Module(LoopModule):
    """A named program that handles messages. While it runs, it is also a Sender.

    Declare resources, handlers and callbacks first. Then call ``run()`` or enter ``running()``. A
    running module sends under the root, in the thread that started it.

    Args:
        name: the module's name, 1 to 128 printable characters. Give each running module its own
            name.
        central: an address such as "tcp://rover:7400", or several with commas, of which one central
            leads; or a ``LocalCentral``. Default: None, which means ``$TCA_CENTRAL`` or else the
            default socket.
        capacity: the number of messages that the module's own resource handles at a time, 1 to 256.
            Default: 1.
        requires: the messages that must have a handler, here or elsewhere, before the module
            serves, also after a restart of central. Modules that require each other wait for ever:
            see 'tca status'. Default: none.

    Raises:
        MisuseError: an argument has the wrong type or range.

    Example::

        planner = Module("gait planner")

        @planner.handles(TAKE_STEPS)
        def take_steps(task: Task, arc: Arc) -> None:
            for _ in range(arc.steps):
                task.command(MOVE_LEG)

        planner.run()
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
        self._start_functions: list[Callable[[Module], object]] = []
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
        """Declare a part of the module that handles *capacity* messages at a time, one thread each.

        Handlers choose a resource with ``resource=``. Handlers without that option use the module's
        own resource. It has the module's name, and can be declared here, too. A resource without a
        handler is a mutex: ``with task.lock("gripper")`` lets one holder at a time continue.

        Args:
            name: the resource's name, 1 to 128 printable characters.
            capacity: the number of messages that the resource handles at a time, 1 to 256. Default:
                1.
            hung: "wait" leaves a slot occupied until its handler returns. "replace" gives the slot
                a new thread when its handler hangs, and abandons the old thread. Default: "wait".
            hung_after: with "replace", the seconds after which a handler counts as hung. They count
                from the kill of the handler's task, or from the time when the sender gave up.
                Default: 5.
            when_busy: the fate of a task that would have to wait: "queue", "preempt" or "reject",
                as in ``HandlerOptions``. A handler that is declared later can override it. Default:
                "queue".

        Returns:
            The name, to be given as ``resource=``.

        Raises:
            MisuseError: the module runs already, or an argument has the wrong type or range.

        Example::

            camera = arm.resource("camera", capacity=2)

            @arm.handles(LOOK, resource=camera)
            def look(task: Task, place: Place) -> Image: ...
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
    @with_options
    def handles(self, message: Message[Any, Any], **options: Unpack[HandlerOptions]) -> Any:
        """Declare the decorated function, plain or ``async def``, as the handler of *message*.

        The function gets the ``Task`` and the message's data; without data, the ``Task`` only. It
        returns the reply of a query, or the result of a command. An exception that it raises is a
        failure of the message. The newest module that declares a handler gets the messages. Modules
        that name the same *pool* share the messages.

        Args:
            message: the message. A module has at most one handler for each message.
            options: see ``HandlerOptions``: resource, pool, pending, accepts, takes,
                refuses, when_busy.

        Returns:
            A decorator that returns the function unchanged.

        Raises:
            MisuseError: the module runs already or handles *message* already; an option is wrong;
                or the function's parameters do not fit the message.

        Example::

            @arm.handles(MOVE, resource="motors")
            def move(task: Task, place: Place) -> Footfall:
                return motors.move_to(place)
        """
        self._check_not_running("handles()")
        check_decorator("handles(MESSAGE)", message)
        handler_format = checked_format(message, options, self.name, self._resources)

        def declare(function: Callable[..., Any]) -> Callable[..., Any]:
            self._add(Handler(message, function, handler_format))
            return function

        return declare

    @with_options
    def serve(
        self, message: TaskMessage[D, R], server: Server[D, R], **options: Unpack[HandlerOptions]
    ) -> None:
        """Declare a ``Server`` as the handler of the tasks of *message*.

        The Server answers the requests of clients for which it has methods. Other requests get the
        default: see ``Server``. Options and errors are those of ``handles``.

        Args:
            message: a goal or command.
            server: an instance of a subclass of ``Server``.
            options: see ``HandlerOptions``, except *takes*.

        Raises:
            MisuseError: as for ``handles``; also for *takes*, and for a *server* that is no Server.

        Example::

            arm.serve(GRASP, Grasping())
        """
        self._check_not_running("serve()")
        check_class(message, Goal, Command, call="serve")
        if "takes" in options:
            advice = "leave out takes=, the Server's methods decide that"
            raise MisuseError(f"serve() of {message.title}: {advice}")
        refused, names = options.get("refuses", ()), server_transitions(message, server)
        options["takes"] = [name for name in names if name not in refused]
        handler_format = checked_format(message, options, self.name, self._resources)
        self._add(ServerHandler(message, server, handler_format))

    def _add(self, handler: Handler) -> None:
        """Add a handler. Raises MisuseError for a second handler of one message."""
        name = handler.message.name
        if known := self._handlers.get(name):
            text = f"module '{self.name}' handles '{name}' already, in {known.name}"
            advice = "leave one of the two out, or give it to another module"
            raise MisuseError(f"{text}: {advice}")
        self._handlers[name] = handler
        self._resources.setdefault(handler.resource, ResourcePlan())

    def at_start(self, function: Start) -> Start:
        """Call the decorated function once the module has joined, before any message comes.

        Attach exception handlers and wiretaps here. An error in the function ends the module. After
        a restart of central, the function is not called again: the library itself reattaches its
        attachments to messages and to the root.

        Args:
            function: takes the Module.

        Returns:
            The function.

        Raises:
            MisuseError: the module runs already, or the function takes other arguments.

        Example::

            @safety.at_start
            def watch(module: Module) -> None:
                module.on_failure(COLLISION, RAISE_LEG, of=MOVE_LEG)
        """
        self._check_not_running("at_start()")
        check_function("at_start()", function, "(module)")
        self._start_functions.append(function)
        return function

    # --- running ----------------------------------------------------------------------------------

    def run(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> None:
        """Handle messages until Ctrl-C, SIGTERM or ``stop()``.

        A second signal ends the process at once. At the end, running handlers are notified and
        waited for: ``task.cancelled`` becomes true, waits raise Stopped, coroutines get
        CancelledError. A notified handler fails with "module lost". A handler that neither waits
        nor reads ``cancelled`` finishes normally.

        Args:
            patience: the seconds to wait for central at the start; also the seconds of central's
                silence after which a wait raises CentralLost, and with several addresses at least
                30. Default: 10.
            reconnect: wait for central when central goes away later. With False, the module ends
                with CentralLost. Default: True.
            linger: at the end, the most seconds to wait until all sent messages have arrived.
                Default: 10.

        Raises:
            CentralLost: no central answered within *patience* seconds; or, with *reconnect* False,
                central went away later.
            NotSent: messages may not have arrived when the module ended.
            MisuseError: the module runs already, or an argument has the wrong type or range.

        Example::

            arm = Module("arm")
            arm.run(patience=60)
        """
        running = self.running(patience=patience, reconnect=reconnect, linger=linger)
        with _stopped_by_signals(self._stop), contextlib.suppress(Stopped), running:
            while not self._stop.wait(_SIGNALS_PERIOD):
                pass

    @block
    def running(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> Iterator["Module"]:
        """Handle messages in the background while a ``with`` block lasts.

        Inside the block, the thread that entered the block can send with the module. The module may
        end before the block: by ``stop()``, or by a KeyboardInterrupt or another error in a handler
        that is not an Exception. That error is logged at once, and raised at the end of the block.
        (SystemExit and asyncio.CancelledError only fail their handlers.)

        Args:
            patience: see ``run``. Default: 10 s.
            reconnect: see ``run``. Default: True.
            linger: see ``run``. Default: 10 s.

        Yields:
            The module.

        Raises:
            CentralLost: no central answered within *patience* seconds.
            NotSent: messages may not have arrived when the module ended.
            MisuseError: the module runs already, or an argument has the wrong type or range.

        Example::

            with planner.running(), connect("test") as user:
                user.goal(TAKE_STEPS, arc).wait(timeout=60)
        """
        if self._link is not None:
            state = "is ending" if self._stop.is_set() else "runs already"
            advice = "leave its 'with module.running():' block before you start it again"
            raise MisuseError(f"module '{self.name}' {state}: {advice}")
        self._check_loop()
        self._stop.clear()
        try:
            self._start(patience, linger, reconnect=reconnect)
        except CentralLost as error:
            raise CentralLost(f"module '{self.name}': {error}") from None
        try:
            yield self
        except BaseException as error:
            for earlier in self._leave(error):
                if isinstance(error, Exception) and not isinstance(earlier, Exception):
                    raise earlier from error  # such as KeyboardInterrupt: must not be hidden
                cause = f"module '{self.name}' had ended before: {type(earlier).__name__}: "
                error.add_note(f"{'' if isinstance(earlier, NotSent) else cause}{earlier}")
            raise
        for first in self._leave():
            raise first

    def stop(self) -> None:
        """End the module, from any thread: ``run`` returns.

        A ``running`` block continues without handlers and callbacks, and can still send. Messages
        then go to the modules that handled them before this module.
        """
        self._stop.set()

    @property
    def stopping(self) -> bool:
        """Whether the module was asked to end."""
        return self._stop.is_set()

    def _start(self, patience: float, linger: float, *, reconnect: bool) -> None:
        """Join central, call the ``at_start`` functions, declare handlers and open slots."""
        check(f"module '{self.name}'", checks.PATIENCE, patience=patience, linger=linger)
        self._linger = linger
        check(f"module '{self.name}'", checks.FLAG, reconnect=reconnect)
        greeting = hello(self.name)
        self._link = link = open_connection(
            self.central, greeting, patience, self._stop.is_set, logs_wait=True
        )
        link.root_sender = self
        if (known := link.session.module) != self.name:
            text = f"another module '{self.name}' runs, so central calls this one '{known}'"
            advice = "give each module its own name, unless the newer one replaces the older"
            self._log.warning("%s: %s", text, advice)
        link.session.replace_slot = self._slots.replace
        try:
            self._wait_for_required(link)
            for function in self._start_functions:
                function(self)
            handlers = self._handlers.values()
            messages, formats = [one.message for one in handlers], [one.format for one in handlers]
            link.declare(*messages, handlers=formats, is_ready=True)
            serving = Serving(
                self.central,
                patience,
                linger,
                self._handlers,
                self._stop,
                link.session.attachments,
            )
            self._open_slots(greeting.incarnation, serving)
        except BaseException as error:
            self._leave(error)
            raise
        self._keep_alive = KeepAlive(link, self._stop, reconnect=reconnect)

    def _wait_for_required(self, link: Connection) -> None:
        """Wait until all required messages that this module does not handle have a handler."""
        if not (required := self.required_elsewhere()):
            return
        link.declare(*required)
        names = link.session.redeclaration.required = [message.name for message in required]
        request = link.request(WaitUntilHandled(0, names, list(self._handlers)), wants_answer=True)
        since, has_warned = time.monotonic(), False
        while not link.wait(request, CHECK_PERIOD, "the wait for required messages"):
            if self._stop.is_set():
                link.abandon(request)
                text = "was stopped while it waited for required messages"
                raise Stopped(f"module '{self.name}' {text}")
            while request.answers:  # central says why the wait may never end
                has_warned = True
                self._log.warning("%s", request.answers.popleft()[0].text)
            if not has_warned and time.monotonic() - since > _WARN_AFTER:
                has_warned = True
                text = "which it requires; see 'tca messages'"
                self._log.warning("waits for handlers of %s, %s", checks.quoted(names), text)

    def required_elsewhere(self) -> list[Message[Any, Any]]:
        """Return the required messages that the module does not handle itself."""
        # A module that waited for its own handlers would never get to declare them.
        return [message for message in self._required if message.name not in self._handlers]

    def _open_slots(self, incarnation: str, serving: Serving) -> None:
        """Start a thread for each slot of the resources in use."""

        def open_slot(number: int, resource: str, callbacks: Callbacks) -> Slot:
            hung_after = self._resources[resource].hung_after
            greeting = hello(self.name, number, resource, incarnation, hung_after)
            slot = Slot(serving, greeting, callbacks)
            if getattr(self.central, "is_stepped", False):
                # One slot after the other, in declared order, so that a test has one transcript.
                slot.ready.wait()
            return slot

        # after() may have been called during the wait for required messages.
        self._resources.setdefault(CALLBACKS, ResourcePlan())
        handled = {handler.resource for handler in self._handlers.values()}
        used = handled | self._slots.with_callbacks
        for name, plan in sorted(self._resources.items()):
            if plan.is_declared and name not in used and plan.capacity > 1:
                text = f"resource '{name}' of module '{self.name}' has no handler"
                advice = f"declare a handler with resource='{name}', or leave capacity= out"
                self._log.warning("%s, so it can only be locked: %s", text, advice)
        # A declared resource without a handler is a mutex: its slot lets others lock it.
        used |= {name for name, plan in self._resources.items() if plan.is_declared}
        opened = [name for name in self._resources if name in used]
        self._slots.open(opened, self._resources, open_slot)

    def _leave(self, why: BaseException | None = None) -> list[BaseException]:
        """Accept no more messages, wait for running handlers, and say goodbye to central.

        Returns the errors that ended the module early.
        """
        link = self._link
        assert link is not None
        if link.is_inherited:
            return []  # the process that started the module says goodbye
        if self._keep_alive is not None:
            self._keep_alive.end()
        self._stop.crash = link.crash = crash_text(why)
        self._stop.set()
        link.leave()
        errors = self._slots.close(why)
        # A slot that lost messages has already waited *linger* seconds: don't wait again.
        has_lingered = any(isinstance(error, NotSent) for error in errors)
        try:
            link.close(0.0 if has_lingered else self._linger, link.session.lost)
        except (CentralLost, Refused) as error:
            errors.append(error)
        if self._keep_alive is not None and self._keep_alive.error is not None:
            errors.insert(0, self._keep_alive.error)
        self._link, self._keep_alive, self._user_loop.loop = None, None, None
        return errors

    def _connection(self) -> Connection:
        """Return the module's connection. Raises MisuseError if the module does not run."""
        if self._link is None:
            advice = "send within 'with module.running():' or from a handler"
            raise MisuseError(f"module '{self.name}' does not run: {advice}")
        self._link.check_thread(f"module '{self.name}'", "runs it")
        return self._link


@contextmanager
def _stopped_by_signals(stop: Stop) -> Iterator[None]:
    """Set *stop* at the first SIGINT or SIGTERM; the second one ends the process at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_signal(*_: Any) -> None:
        stop.set_from_signal()
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, on_signal) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
