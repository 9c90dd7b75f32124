"""The part of a Module that declares functions to be called between messages."""

from collections.abc import Callable, Collection
from typing import Any, TypeVar

from tca_module import checks
from tca_module.checks import check
from tca_module.errors import MisuseError
from tca_module.link.connection import Connection
from tca_module.sending.sender import Sender
from tca_module.serving.callbacks import Callback, Callbacks, HasFileno, ObservingFunction
from tca_module.serving.handler_options import ResourcePlan
from tca_module.serving.slot import CALLBACKS, Slots
from tca_wire.messages.declarations import Message

CallbackFunction = Callable[[Callback], object] | Callable[[], object]
F = TypeVar("F", bound=CallbackFunction)
O = TypeVar("O", bound=ObservingFunction)  # noqa: E741 - as F


class ModuleCallbacks(Sender):
    """The calls of a Module that declare callbacks."""

    name: str
    _link: Connection | None
    _resources: dict[str, ResourcePlan]
    _slots: Slots

    def every(self, period: float, *, resource: str | None = None) -> Callable[[F], F]:
        """Call the decorated function every *period* seconds while the module runs.

        The first call is one period after the start. Calls are due at multiples of the period,
        without drift; a missed call is skipped. The thread of *resource* makes the calls between
        messages. Errors are logged.

        Args:
            period: seconds, 1e-6 to 1e7.
            resource: the resource whose thread makes the calls. Default: None, a thread for
                callbacks only.

        Returns:
            A decorator that returns the function unchanged. The function takes nothing, or the
            ``Callback``, with which it sends and can ``cancel()``. A parameter with a default keeps
            its default: ``lambda n=n: ...``.

        Raises:
            MisuseError: an argument has the wrong type or range, or the function takes other
                arguments.

        Example::

            @driver.every(0.1)
            def poll(callback: Callback) -> None:
                callback.inform(BATTERY, read_level())
        """
        checks.check_decorator("every(PERIOD)", period)
        check("every()", checks.PERIOD, period=period)
        check("every()", checks.NAME_OR_NONE, resource=resource)

        def declare(function: F) -> F:
            self._callbacks_of("every()", resource).every(period, function)
            return function

        return declare

    def observes(
        self,
        message: Message[Any, Any] | None = None,
        *,
        states: Collection[str] = (),
        resource: str | None = None,
    ) -> Callable[[O], O]:
        """Call the decorated function with each change of state of the tasks of *message*.

        The first calls are for the present state of each living task (``is_late``). The senders and
        handlers of the tasks need not know of the observer. The thread of *resource* makes the
        calls between messages. Errors are logged.

        Args:
            message: the message whose tasks are observed. Default: None, all tasks.
            states: call the function only for changes to these states. Default: every change.
            resource: the resource whose thread makes the calls. Default: None, a thread for
                callbacks only.

        Returns:
            A decorator that returns the function unchanged. The function takes (sender, change) or
            (change).

        Raises:
            MisuseError: the module runs already, the tasks never have one of the *states*, or the
                function takes other arguments.

        Example::

            @head.observes(GRASP, states=["running"])
            def look(sender: Sender, change: Change) -> None:
                sender.inform(GAZE, change.goal.place)
        """
        self._check_not_running("observes()")
        checks.check_decorator("observes(MESSAGE)", message)
        check("observes()", checks.NAME_OR_NONE, resource=resource)

        def declare(function: O) -> O:
            self._callbacks_of("observes()", resource).observe(message, states, function)
            return function

        return declare

    def after(
        self, delay: float, function: CallbackFunction, *, resource: str | None = None
    ) -> Callback:
        """Call a function once, *delay* seconds from now, or from the module's start.

        The delay counts from the start if the module does not run yet. Any thread may call this at
        any time. The function and the thread that calls it are as for ``every``.

        Args:
            delay: seconds, 0 to 1e7.
            function: takes the ``Callback``, or nothing.
            resource: the resource whose thread makes the call. Default: None, a thread for
                callbacks only.

        Returns:
            The Callback; its ``cancel()`` prevents the call.

        Raises:
            MisuseError: an argument has the wrong type or range, or the function takes other
                arguments.

        Example::

            lamp.after(2.0, lambda callback: callback.inform(BLINK, "green"))
        """
        return self._callbacks_of("after()", resource).after(delay, function)

    def on_readable(
        self, source: int | HasFileno, function: CallbackFunction, *, resource: str | None = None
    ) -> Callback:
        """Call a function whenever a file, socket or pipe has data to read.

        The function must read the data; otherwise it is called again at once. Cancel the callback
        before you close the file. Any thread may call this at any time. The thread that calls the
        function is as for ``every``.

        Args:
            source: an object with ``fileno()``, or a file number.
            function: takes the ``Callback``, or nothing.
            resource: the resource whose thread makes the calls. Default: None, a thread for
                callbacks only.

        Returns:
            The Callback; its ``cancel()`` ends the calls.

        Raises:
            MisuseError: *source* is no open file, or the function takes other arguments.

        Example::

            driver.on_readable(serial_port, lambda: decode(serial_port.read()))
        """
        return self._callbacks_of("on_readable()", resource).on_readable(source, function)

    def _callbacks_of(self, call: str, resource: str | None) -> Callbacks:
        """Return the callbacks of a resource's thread. *call* is the public method, for errors."""
        check(call, checks.NAME_OR_NONE, resource=resource)
        named = resource or CALLBACKS
        if self._link is None:
            self._resources.setdefault(named, ResourcePlan())
        else:
            self._link.check_process()
        return self._slots.callbacks(named)

    def _check_not_running(self, call: str) -> None:
        if self._link is not None:
            what = f"{call} of module '{self.name}'"
            raise MisuseError(f"{what} comes too late: declare it before run()")
