"""A contestant in a process of its own, and its measurements there.

All processes that a contestant starts end with its driver, even if the driver is killed.
"""

import contextlib
import importlib
import multiprocessing
import os
import signal
import statistics
import time
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from dev.benchmarks.messages.cases import Case, Entry, Kind
from dev.benchmarks.messages.contestant import Contestant
from dev.benchmarks.messages.processes import processor_seconds

_STARTED_WITHIN = 60.0
_ANSWERED_WITHIN = 1800.0
_ENDED_WITHIN = 10.0
_PART = 0.2
"""The share of a measurement's time that a call should take. After a shorter call, the next call
gets more messages.
"""


class Figure(NamedTuple):
    """A measurement."""

    value: float
    """The median of times, the rate, or the number."""
    p99: float | None = None
    """The 99th percentile of times."""
    broker: float | None = None
    """The broker's processor time for a message, in seconds."""


Figures = list[Figure | str]
"""A figure for each part of a case, or the reason why there is none."""


class Driver:
    """A contestant, as the benchmark controls it."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry
        self.is_stopped = False
        self._pipe, remote_end = multiprocessing.get_context("spawn").Pipe()
        self._process = multiprocessing.get_context("spawn").Process(
            target=_drive, args=(remote_end, entry)
        )
        self._process.start()
        remote_end.close()

    def start(self) -> None:
        """Wait until the contestant can be measured. Raises Broken."""
        self._receive(_STARTED_WITHIN)

    def measure(self, case: Case, seconds: float) -> Figures:
        """Measure a case for some seconds. Raises Broken."""
        self._pipe.send((case, seconds))
        figures: Figures = self._receive(_ANSWERED_WITHIN)
        return figures

    def stop(self) -> None:
        """Stop the contestant, and all that it has started. A second call does nothing."""
        if self.is_stopped:
            return
        self.is_stopped = True
        with contextlib.suppress(OSError):
            self._pipe.close()
        self._process.join(_ENDED_WITHIN)
        assert self._process.pid is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.join()

    def _receive(self, seconds: float) -> Any:
        try:
            if not self._pipe.poll(seconds):
                raise Broken(f"no answer within {seconds:g} s")
            is_fine, answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise Broken("its process ended") from error
        if not is_fine:
            raise Broken(answer)
        return answer


class Broken(Exception):
    """A contestant can't continue; the text says why."""


def _drive(pipe: Connection, entry: Entry) -> None:
    """Run the driver's process: start the contestant, then measure until no request follows."""
    os.setpgid(0, 0)  # only the benchmark itself handles Ctrl-C
    contestant = None
    try:
        contestant = _new_contestant(entry)
        contestant.start()
        contestant.ready()
        pipe.send((True, None))
        while True:
            pipe.send((True, _figures(contestant, *pipe.recv())))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass  # the benchmark has ended
    except BaseException as error:  # noqa: BLE001 - any program may raise any error
        with contextlib.suppress(OSError):
            pipe.send((False, f"{type(error).__name__}: {error}"))
    finally:
        if contestant:
            contestant.stop()


def _new_contestant(entry: Entry) -> Contestant:
    module = importlib.import_module(f"dev.benchmarks.messages.{entry.module}")
    contestant: Contestant = getattr(module, entry.class_name)(**entry.options)
    return contestant


def _figures(contestant: Contestant, case: Case, seconds: float) -> Figures:
    """Return the figures of a case, or the reasons why there are none."""
    act = getattr(contestant, case.method)
    try:
        if case.kind is Kind.NUMBER:
            found = act(case.number, *case.arguments)
            return [one if isinstance(one, str) else Figure(one) for one in found]
        before = processor_seconds(contestant.broker) if contestant.broker else 0.0
        p99, messages = None, 0
        if case.kind is Kind.RATE:
            value, messages = _rate(act, case, seconds)
        else:
            times = _times(act, case, seconds)
            value, p99, messages = (
                statistics.median(times),
                times[len(times) * 99 // 100],
                len(times),
            )
    except NotImplementedError as error:
        return [str(error) or "not measured"] * len(case.parts)
    if not contestant.broker:
        return [Figure(value, p99)]
    return [Figure(value, p99, (processor_seconds(contestant.broker) - before) / messages)]


def _times(act: Any, case: Case, seconds: float) -> list[float]:
    """Return the seconds of each message, sorted."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while not times or time.perf_counter() < end:
        times += act(case.number, *case.arguments)
    return sorted(times)


def _rate(act: Any, case: Case, seconds: float) -> tuple[float, int]:
    """Return the number per second, and the number of all messages.

    Later calls send more messages, so that the way back of the last message counts for little.
    """
    number, done, total, messages = case.number, 0, 0.0, 0
    while total < seconds:
        begin = time.perf_counter()
        act(number, *case.arguments)
        took = time.perf_counter() - begin
        messages += number
        if took < seconds * _PART and number < case.most:
            number = min(number * 2, case.most)
            done, total = 0, 0.0
            continue
        done, total = done + number, total + took
    return done / total, messages
