"""Functions that a module's thread calls between messages: at a time, or when a file has something to read."""

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, TypeVar

from tca_module.checks import DELAY, PERIOD, check, check_function
from tca_module.errors import ORDINARY, MisuseError
from tca_module.link.connection import Connection
from tca_module.log import log_of
from tca_module.sending.sender import Sender
from tca_module.serving.state_observers import StateObserver
from tca_module.sockets.transport import Transport

T = TypeVar("T")


class _Timer:
    """A time at which something is due: *start* plus a multiple of *period*, or *start* alone."""

    def __init__(self, start: float, period: float) -> None:
        self.due = start + period
        self._start = start
        self._period = period
        self._turn = 1

    def go_on(self, now: float) -> bool:
        """Be due at the next multiple of the period, whatever was missed; False if it was due once and for all."""
        if self._period:
            self._turn = max(self._turn, math.floor((now - self._start) / self._period)) + 1
            self.due = self._start + self._turn * self._period
        return self._period > 0


class Timers(Generic[T]):
    """Things that are due once, or over and over at multiples of a period. Times, in seconds, are passed in."""

    def __init__(self) -> None:
        self._timers: dict[T, _Timer] = {}

    def once(self, thing: T, at: float) -> None:
        """Let it be due once."""
        self._timers[thing] = _Timer(at, 0.0)

    def every(self, thing: T, period: float, now: float) -> None:
        """Let it be due whenever *period* has passed since now."""
        self._timers[thing] = _Timer(now, period)

    def remove(self, thing: T) -> None:
        """Let it not be due any more, if it ever was."""
        self._timers.pop(thing, None)

    def next(self) -> float:
        """The next time at which something is due; infinity if there is none."""
        return min((timer.due for timer in self._timers.values()), default=math.inf)

    def take_due(self, now: float) -> list[T]:
        """The things that have become due, in that order. None is due again before it ``was_done``."""
        due = [thing for thing, timer in self._timers.items() if timer.due <= now]
        due.sort(key=lambda thing: self._timers[thing].due)
        for thing in due:
            self._timers[thing].due = math.inf
        return due

    def was_done(self, thing: T, now: float) -> bool:
        """A thing that was due has been done, by now; whether it will be due again."""
        timer = self._timers.pop(thing, None)
        if timer is None or not timer.go_on(now):
            return False
        self._timers[thing] = timer
        return True


class HasFileno(Protocol):
    """A socket, pipe, serial port, ..."""

    def fileno(self) -> int:
        """The number of its file."""


class Callback(Sender):
    """A function that is called between messages, and a Sender for it: under the root. Sends only from inside the
    function; ``cancel`` works from anywhere.
    """

    def __init__(self, owner: "Callbacks", function: Callable[..., object], *, is_once: bool = False) -> None:
        super().__init__()
        self.name = getattr(function, "__qualname__", repr(function))
        self.function = function
        self.is_once = is_once
        self.arguments = check_function("a callback", function, "(callback) or ()", (1, 0))
        self._owner = owner

    def __repr__(self) -> str:
        return f"callback {self.name}"

    @property
    def is_over(self) -> bool:
        """Whether it will not be called any more."""
        return self not in self._owner

    def cancel(self) -> None:
        """Call it no more; from any thread, also from inside. Twice does no harm."""
        self._owner.remove(self)

    def _connection(self) -> Connection:
        if self._owner.connection is None:
            raise MisuseError(f"{self} can't send: its module does not run")
        return self._owner.connection


class Callbacks:
    """The callbacks of one thread, called in the order they came due. The next thread starts their times anew."""

    def __init__(self, module: str) -> None:
        self.connection: Connection | None = None  #: of the thread that calls them
        self._lock = threading.RLock()
        self._starts: dict[Callback, Callable[[float], None]] = {}  #: by callback: lets it be due, from now on
        self._observers: list[StateObserver] = []
        self.files: dict[int, Callback] = {}  #: the files to wait for, and who waits for each
        self._timers: Timers[Callback] = Timers()
        self._due: deque[Callback] = deque()
        self._log = log_of(module)

    def __contains__(self, callback: object) -> bool:
        return callback in self._starts

    def __bool__(self) -> bool:
        return bool(self._starts or self._observers)

    def every(self, period: float, function: Callable[..., object]) -> Callback:
        """Call a function periodically."""
        check("every()", PERIOD, period=period)
        callback = Callback(self, function)
        return self._add(callback, lambda now: self._timers.every(callback, period, now))

    def after(self, delay: float, function: Callable[..., object]) -> Callback:
        """Call a function once."""
        check("after()", DELAY, delay=delay)
        callback = Callback(self, function, is_once=True)
        return self._add(callback, lambda now: self._timers.once(callback, now + delay))

    def on_readable(self, source: int | HasFileno, function: Callable[..., object]) -> Callback:
        """Call a function while a file has something to read."""
        file = _checked_file(source)
        callback = Callback(self, function)
        with self._lock:
            if (known := self.files.get(file)) is not None:
                raise MisuseError(f"{known} waits for file {file} already: cancel() that first")
            self.files[file] = callback
            return self._add(callback, lambda _: None)

    def observe(self, observer: StateObserver) -> None:
        """Call a function with changes of tasks' states, from the thread's beginning on."""
        self._observers.append(observer)

    def _add(self, callback: Callback, start: Callable[[float], None]) -> Callback:
        with self._lock:
            self._starts[callback] = start
            if self.connection is not None:
                start(self.connection.transport.time())
                self.connection.transport.wake()
        return callback

    def remove(self, callback: Callback) -> None:
        """Call it no more."""
        with self._lock:
            self._starts.pop(callback, None)
            self._timers.remove(callback)
            self.files = {file: one for file, one in self.files.items() if one is not callback}

    def begin(self, connection: Connection) -> None:
        """A thread calls them from now on."""
        with self._lock:
            self.connection = connection
            for start in self._starts.values():
                start(connection.transport.time())
        for observer in self._observers:
            observer.begin(connection)

    def end(self) -> None:
        """Nobody calls them any more."""
        with self._lock:
            self.connection = None
            self._timers = Timers()
            self._due.clear()

    @property
    def _transport(self) -> Transport:
        """What the thread waits for, with the clock that the times of callbacks are of."""
        assert self.connection is not None
        return self.connection.transport

    def patience(self, seconds: float) -> float:
        """The seconds that the thread may wait, at most so many: until something is due."""
        with self._lock:
            return min(seconds, self._transport.seconds_until(self._timers.next()))

    def found(self, ready: Mapping[int, bool]) -> None:
        """The wait is over: these files can be read, or (False) are closed."""
        with self._lock:
            self._due.extend(self._timers.take_due(self._transport.time()))
            for file, is_open in ready.items():
                callback = self.files.get(file)
                if callback is not None and is_open:
                    self._due.append(callback)
                elif callback is not None:
                    self._log.error("%s is called no more: its file %d was closed", callback, file)
                    self.remove(callback)

    def call_one(self) -> bool:
        """Call the one due first; False if none is."""
        if not self._due:
            return False
        callback = self._due.popleft()
        if callback in self:
            if callback.is_once:
                self.remove(callback)
            self._call(callback)
            with self._lock:
                self._timers.was_done(callback, self._transport.time())
        return True

    def _call(self, callback: Callback) -> None:
        try:
            callback.function(*(callback,)[: callback.arguments])
            if self.connection is not None:
                self.connection.settle(0, wait=True)
        except ORDINARY:  # its author reads the log
            self._log.exception("%s failed", callback)


def _checked_file(source: Any) -> int:
    try:
        file = source if isinstance(source, int) else source.fileno()
    except (AttributeError, OSError, ValueError):
        file = None
    if isinstance(file, bool) or not isinstance(file, int) or not 0 <= file < 2**31:
        raise MisuseError(
            f"on_readable(): source must be an open file, socket or pipe, or its number, not {source!r:.60}"
        )
    return file
