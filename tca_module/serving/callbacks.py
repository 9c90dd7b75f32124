"""Functions that a module's thread calls between messages, at a time or when a file is readable."""

import math
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, Protocol

from tca_module.checks import DELAY, check, check_function
from tca_module.errors import MisuseError
from tca_module.following.mirror import ChangeCallback
from tca_module.following.observation import Observation
from tca_module.link.connection import Connection
from tca_module.log import log_of
from tca_module.sending.sender import Sender
from tca_module.sending.task_ref import Change, change_of
from tca_module.sending.watching import checked_states
from tca_module.sockets.transport import Transport
from tca_wire.messages.declarations import Message
from tca_wire.packets.changes import Observe


class HasFileno(Protocol):
    """An object with a file number, such as a socket, pipe or serial port."""

    def fileno(self) -> int:
        """Return the number of its file."""


ObservingFunction = Callable[[Sender, Change], object] | Callable[[Change], object]


class DueTime:
    """The time at which a callback is due: once, or at each multiple of a period.

    Missed multiples are skipped. The caller passes the time.
    """

    def __init__(self, seconds: float, *, is_once: bool) -> None:
        self.due = math.inf  #: infinite before ``begin`` and while the callback runs
        self.is_once = is_once
        self._seconds = seconds
        self._start, self._multiple = 0.0, 1

    def begin(self, now: float) -> None:
        """Count from now on."""
        self._start, self._multiple, self.due = now, 1, now + self._seconds

    def schedule_next(self, now: float) -> None:
        """Compute the next due time after a call has ended."""
        if not self.is_once:
            passed = math.floor((now - self._start) / self._seconds)
            self._multiple = max(self._multiple, passed) + 1
            self.due = self._start + self._multiple * self._seconds


class Callback(Sender):
    """A function that a module's thread calls between messages.

    ``module.every()``, ``after()`` and ``on_readable()`` declare such functions. Each function is
    called with its Callback. A Callback is a Sender: the tasks that the function sends with it
    become children of the root. A Callback can send only while its function runs; ``cancel`` works
    at any time.

    Example::

        @module.every(0.1)
        def steer(callback: Callback) -> None:
            if callback.query(IS_DONE):
                callback.cancel()
    """

    def __init__(
        self, owner: "Callbacks", function: Callable[..., object], when: DueTime | None = None
    ) -> None:
        super().__init__()
        self.name = getattr(function, "__qualname__", repr(function))
        self.function = function
        self.when = when  #: when the function is due; None if it waits for a file
        self.arguments = check_function("a callback", function, "(callback) or ()", (1, 0))
        self._owner = owner

    def __repr__(self) -> str:
        return f"callback {self.name}"

    @property
    def is_over(self) -> bool:
        """Whether the function will not be called any more."""
        return self not in self._owner

    def cancel(self) -> None:
        """Stop calling the function.

        May be called from any thread, also from inside the function, and more than once.
        """
        self._owner.remove(self)

    def _connection(self) -> Connection:
        if self._owner.connection is None:
            raise MisuseError(f"{self} can't send: its module is not running")
        return self._owner.connection


class Callbacks:
    """The callbacks of one thread, called in the order in which they come due.

    The callbacks' times start again with each thread, that is, with each run of the module.
    """

    def __init__(self, module: str) -> None:
        self.connection: Connection | None = None  #: of the thread that calls the callbacks
        self._lock = threading.RLock()
        self._known: dict[Callback, None] = {}  #: in order of declaration
        self._observers: list[Callable[[Connection], None]] = []  #: called when the thread starts
        self.files: dict[int, Callback] = {}  #: file to wait for -> its callback
        self._due: deque[Callback] = deque()
        self._log = log_of(module)

    def __contains__(self, callback: object) -> bool:
        return callback in self._known

    def __bool__(self) -> bool:
        return bool(self._known or self._observers)

    def every(self, period: float, function: Callable[..., object]) -> Callback:
        """Call a function periodically."""
        return self._add(Callback(self, function, DueTime(period, is_once=False)))

    def after(self, delay: float, function: Callable[..., object]) -> Callback:
        """Call a function once, after a delay."""
        check("after()", DELAY, delay=delay)
        return self._add(Callback(self, function, DueTime(delay, is_once=True)))

    def on_readable(self, source: int | HasFileno, function: Callable[..., object]) -> Callback:
        """Call a function whenever a file has something to read."""
        file = _checked_file(source)
        callback = Callback(self, function)
        with self._lock:
            if (known := self.files.get(file)) is not None:
                raise MisuseError(f"{known} waits for file {file} already: cancel() it first")
            self.files[file] = callback
            return self._add(callback)

    def observe(
        self,
        message: Message[Any, Any] | None,
        states: Collection[str],
        function: ObservingFunction,
    ) -> None:
        """Call a function with changes of tasks' states, from the thread's start on.

        The changes are those of the tasks of all senders and handlers.
        """
        check_function("observes()", function, "(sender, change) or (change)", (2, 1))
        wanted = checked_states("observes()", message, states)
        header = Observe(0, message=message.name if message is not None else "", states=wanted)
        self._observers.append(partial(_observe, message, header, function))

    def _add(self, callback: Callback) -> Callback:
        with self._lock:
            self._known[callback] = None
            if self.connection is not None:
                if callback.when is not None:
                    callback.when.begin(self._transport.time())
                self._transport.wake()
        return callback

    def remove(self, callback: Callback) -> None:
        """Stop calling a callback."""
        with self._lock:
            self._known.pop(callback, None)
            self.files = {file: one for file, one in self.files.items() if one is not callback}

    def begin(self, connection: Connection) -> None:
        """Let the thread of *connection* call the callbacks from now on."""
        with self._lock:
            self.connection = connection
            for time in self._times().values():
                time.begin(connection.transport.time())
        for observer in self._observers:
            observer(connection)

    def end(self) -> None:
        """Call nothing more, because the thread ends."""
        with self._lock:
            self.connection = None
            self._due.clear()

    def _times(self) -> dict[Callback, DueTime]:
        return {callback: callback.when for callback in self._known if callback.when is not None}

    @property
    def _transport(self) -> Transport:
        """The thread's transport, whose clock the callbacks' times refer to."""
        assert self.connection is not None
        return self.connection.transport

    def seconds_until_due(self, seconds: float) -> float:
        """Return the seconds until a callback is due, at most *seconds*."""
        with self._lock:
            first = min((time.due for time in self._times().values()), default=math.inf)
            return min(seconds, self._transport.seconds_until(first))

    def queue_due(self, ready: Mapping[int, bool]) -> None:
        """Queue the callbacks that are due after a wait.

        *ready*: file -> True if it became readable, False if it is closed.
        """
        with self._lock:
            now = self._transport.time()
            due = [(time, callback) for callback, time in self._times().items() if time.due <= now]
            for time, callback in sorted(due, key=lambda one: one[0].due):
                self._due.append(callback)
                time.due = math.inf
            for file, is_open in ready.items():
                waiting = self.files.get(file)
                if waiting is not None and is_open:
                    self._due.append(waiting)
                elif waiting is not None:
                    self._log.error("%s is not called any more: file %d is closed", waiting, file)
                    self.remove(waiting)

    def call_one(self) -> bool:
        """Call the callback that came due first; return False if none is due."""
        if not self._due:
            return False
        callback = self._due.popleft()
        if callback in self and self.connection is not None:
            if callback.when is not None and callback.when.is_once:
                self.remove(callback)
            given = (callback,)[: callback.arguments]
            self.connection.call_back(partial(callback.function, *given), callback)
            if callback.when is not None:
                callback.when.schedule_next(self._transport.time())
        return True


def _observe(
    message: Message[Any, Any] | None,
    header: Observe,
    function: ObservingFunction,
    connection: Connection,
) -> None:
    """Call *function* with changes in the thread of a connection. Raises what ``declare`` does."""
    if message is not None:
        connection.declare(message)
    what = f"observing '{message.name}'" if message is not None else "observing all tasks"
    callback = ChangeCallback(
        "observes()", connection, function, lambda news: change_of(connection, news)
    )
    Observation(connection, header, what).call(callback.put)


def _checked_file(source: Any) -> int:
    try:
        file = source if isinstance(source, int) else source.fileno()
    except (AttributeError, OSError, ValueError):
        file = None
    if isinstance(file, bool) or not isinstance(file, int) or not 0 <= file < 2**31:
        wanted = "an open file, socket or pipe, or its number"
        raise MisuseError(f"on_readable(): source must be {wanted}, not {source!r:.60}")
    return file
