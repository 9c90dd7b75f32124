"""The engine of a replicated log in a simulation, and the ways to it, which lose and delay."""

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeVar

from log_model import LogModel, Lost, Stored
from simulation.clockwork import Clockwork
from simulation.fibers import Fiber
from simulation.options import Options

T = TypeVar("T")
LATEST = 4.0
"""The longest time that a request is under way if it does not arrive in time."""


class Engine(LogModel):
    """The engine. It does not answer for some time.

    While too few servers run, it refuses other messages than the one that it can't store yet.
    """

    def __init__(self, clockwork: Clockwork, options: Options) -> None:
        super().__init__(lambda: clockwork.now)
        self._clockwork, self._options = clockwork, options
        self._is_held = False  #: whether a message is not stored yet
        self.down_until = 0.0
        self.ways: list[Way] = []

    @property
    def is_up(self) -> bool:
        """Whether the engine answers."""
        return self._clockwork.now >= self.down_until

    def append(self, stored: Stored) -> bool:
        """Append a message, and notify the clients that wait for one. Raises Lost."""
        if self._is_held:
            return False
        is_next = stored.message.sequence == self.last + 1
        if is_next and self._clockwork.chance(self._options.held_messages):
            self._is_held = True
            self._clockwork.after(self._clockwork.between(0.0, LATEST), self._release, stored)
            raise Lost
        return self._store(stored)

    def _release(self, stored: Stored) -> None:
        """Store a message that was held, or lose it."""
        self._is_held = False
        if self._clockwork.chance(0.7):
            self._store(stored)

    def _store(self, stored: Stored) -> bool:
        if not super().append(stored):
            return False
        for way in self.ways:
            way.notify()
        return True


class Caller(Protocol):
    """The process of a client."""

    fiber: Fiber

    def fault(self) -> None:
        """Let the process die at this step, perhaps."""


class Way:
    """The way of one client to the engine."""

    def __init__(
        self, engine: Engine, clockwork: Clockwork, options: Options, caller: Caller
    ) -> None:
        self._engine, self._clockwork = engine, clockwork
        self._options, self._caller = options, caller
        self.cut_until = 0.0  #: the client can't reach the engine until then
        self.is_gone = False  #: whether the process has ended
        self._awaits: Callable[[], bool] | None = None
        engine.ways.append(self)

    @property
    def is_open(self) -> bool:
        """Whether packets pass."""
        return self._engine.is_up and self._clockwork.now >= self.cut_until

    def send(self, apply: Callable[[], T]) -> T:
        """Carry a request and its answer, unless one of them is lost."""
        clockwork, options = self._clockwork, self._options
        if not self.is_open:
            raise Lost
        self._pass_time()
        if not self.is_open or clockwork.chance(options.lost_requests):
            if clockwork.chance(0.5):
                clockwork.after(clockwork.between(0.0, LATEST), _arrive_late, apply)
            raise Lost
        found = apply()
        self._pass_time()
        if not self.is_open or clockwork.chance(options.lost_answers):
            raise Lost
        return found

    def _pass_time(self) -> None:
        self._caller.fault()
        if self._clockwork.chance(0.5):
            self._caller.fiber.sleep(self._clockwork.between(0.0, self._options.log_delay))

    def wait(self, seconds: float, is_over: Callable[[], bool]) -> None:
        """Wait some seconds, or until the client hears that *is_over*."""
        if not is_over():
            self._awaits = is_over
            self._caller.fiber.sleep(seconds)
            self._awaits = None

    def notify(self) -> None:
        """End a wait that is over."""
        if self._awaits is not None and self.is_open and self._awaits():
            self._awaits = None
            self._caller.fiber.nudge(self._clockwork.between(0.0, self._options.log_delay))

    def carries_signs(self) -> bool:
        """Whether others receive the client's signs of life now."""
        return (
            self.is_open
            and not self.is_gone
            and (self._clockwork.now >= self._caller.fiber.frozen_until)
        )


def _arrive_late(apply: Callable[[], object]) -> None:
    with suppress(Lost):
        apply()
