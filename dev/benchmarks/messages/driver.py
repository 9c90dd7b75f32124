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
from typing import Any

from dev.benchmarks.messages.cases import Case, Entry, Kind
from dev.benchmarks.messages.contestant import Contestant

_STARTED_WITHIN = 60.0
_ANSWERED_WITHIN = 300.0
_ENDED_WITHIN = 10.0
_PART = 0.2
"""The share of a measurement's time that a call should take. After a shorter call, the next call
gets more messages.
"""

Figures = tuple[float, float | None]
"""A measurement: the median of times, the rate or the number. The second figure is the 99th
percentile of times; otherwise None.
"""


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

    def measure(self, case: Case, seconds: float) -> Figures | None:
        """Measure a case for some seconds; None if the contestant can't do it. Raises Broken."""
        self._pipe.send((case, seconds))
        figures: Figures | None = self._receive(_ANSWERED_WITHIN)
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


def _figures(contestant: Contestant, case: Case, seconds: float) -> Figures | None:
    """Return the figures of a case; None if the contestant does not define its method."""
    if getattr(type(contestant), case.method, None) is getattr(Contestant, case.method, None):
        return None
    act = getattr(contestant, case.method)
    if case.kind is Kind.NUMBER:
        return act(case.number, *case.arguments), None
    if case.kind is Kind.RATE:
        return _rate(act, case, seconds), None
    times: list[float] = []
    end = time.perf_counter() + seconds
    while not times or time.perf_counter() < end:
        times += act(case.number, *case.arguments)
    times.sort()
    return statistics.median(times), times[len(times) * 99 // 100]


def _rate(act: Any, case: Case, seconds: float) -> float:
    """Return the number per second.

    Later calls send more messages, so that the way back of the last message counts for little.
    """
    number, done, total = case.number, 0, 0.0
    while total < seconds:
        begin = time.perf_counter()
        act(number, *case.arguments)
        took = time.perf_counter() - begin
        if took < seconds * _PART and number < case.most:
            number = min(number * 2, case.most)
            done, total = 0, 0.0
            continue
        done, total = done + number, total + took
    return done / total
