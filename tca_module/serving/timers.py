"""Timers: which are due when. Knows no clock and no thread: time is passed in, in seconds."""

import heapq
import itertools
import math
from typing import Generic, TypeVar

T = TypeVar("T")

_VOID_ENTRIES = 64  # that the heap may hold beyond as many as it has valid ones


class _Timer:
    """When something is due: at *start* plus a multiple of *period*, or without period once, at *start*."""

    def __init__(self, start: float, period: float) -> None:
        self.due = start + period
        self.ticket = 0  #: of its entry in the heap; others are void
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
    """Things that are due at a time: once, or over and over at multiples of a period, without drift."""

    def __init__(self) -> None:
        self._timers: dict[T, _Timer] = {}
        self._heap: list[tuple[float, int, T]] = []  #: (due, ticket, thing)
        self._tickets = itertools.count(1)

    def once(self, thing: T, at: float) -> None:
        """Let it be due once."""
        self._start(thing, _Timer(at, 0.0))

    def every(self, thing: T, period: float, now: float) -> None:
        """Let it be due whenever *period* has passed since now."""
        self._start(thing, _Timer(now, period))

    def remove(self, thing: T) -> None:
        """Let it not be due any more, if it ever was."""
        self._timers.pop(thing, None)
        if len(self._heap) > 2 * len(self._timers) + _VOID_ENTRIES:
            self._heap = [entry for entry in self._heap if self._is_valid(entry)]
            heapq.heapify(self._heap)

    def take_due(self, now: float) -> list[T]:
        """The things that have become due, in that order. None is due again before it ``was_done``."""
        due = []
        while self.next() <= now:
            due.append(heapq.heappop(self._heap)[2])
        return due

    def was_done(self, thing: T, now: float) -> bool:
        """A thing that was due has been done, by now; whether it will be due again."""
        timer = self._timers.pop(thing, None)
        if timer is None or not timer.go_on(now):
            return False
        self._start(thing, timer)
        return True

    def next(self) -> float:
        """When something becomes due; infinity if nothing ever does."""
        while self._heap and not self._is_valid(self._heap[0]):
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else math.inf

    def _start(self, thing: T, timer: _Timer) -> None:
        timer.ticket = next(self._tickets)
        self._timers[thing] = timer
        heapq.heappush(self._heap, (timer.due, timer.ticket, thing))

    def _is_valid(self, entry: tuple[float, int, T]) -> bool:
        timer = self._timers.get(entry[2])
        return timer is not None and timer.ticket == entry[1]
