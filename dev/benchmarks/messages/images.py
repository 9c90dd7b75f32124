"""Images: frames of 6 MB from a sender to viewers, each viewer in a process of its own."""

import os
import time
from abc import abstractmethod
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from dev.benchmarks.messages.contestant import SOON, Contestant, Lost, NotThere, run_open, until
from dev.benchmarks.messages.processes import processor_seconds

Frame = npt.NDArray[np.uint8]
SIZE = 6_000_000
"""The bytes of a frame, as a numpy array."""
ONE, THREE = "one", "three"
"""The topics of images, each with its number of viewers."""
_VIEWERS = {ONE: 1, THREE: 3}
_UNDERWAY = 4
"""The frames that a stream has under way at most."""
_PERIOD = 1 / 30
_LATEST = 1.0
"""The seconds after which a frame of the camera counts as lost."""
_NOTED = 4096
"""The frames whose arrivals fit into a viewer's file. Older ones are overwritten."""


class Viewer:
    """A receiver of frames. It notes the time of each arrival in a file that the sender reads."""

    def __init__(self, path: str) -> None:
        self._times = np.memmap(path, float, "r+")

    def __call__(self, data: Any) -> None:
        """Note the time; then look at the ends of a frame, and at a byte of each page."""
        now, frame = time.monotonic(), np.frombuffer(data, np.uint8)
        number = int(frame[:8].view(np.int64)[0])
        assert frame.size == SIZE
        assert frame[-1] == number % 256
        self._light = int(frame[::4096].sum())
        self._times[number % _NOTED] = now


class Audience:
    """The viewers of a topic, as the sender sees them."""

    def __init__(self, contestant: "Showing", topic: str) -> None:
        paths = [str(contestant.folder / f"{topic}-{one}") for one in range(_VIEWERS[topic])]
        for path in paths:
            np.zeros(_NOTED).tofile(path)
        self.viewers = [contestant.start_viewer(topic, path) for path in paths]
        self._times = [np.memmap(path, float, "r+") for path in paths]
        self._show = partial(contestant.show, topic)
        self._frame = np.resize(np.arange(251, dtype=np.uint8), SIZE)
        self._number = 0
        until(self._check_seen)

    def _check_seen(self) -> None:
        try:
            self.wait(*self.send(), seconds=1.0)
        except Lost as error:
            raise NotThere("not all viewers are connected yet") from error

    def send(self) -> tuple[int, float]:
        """Show a new frame. Return its number and the time before."""
        self._number += 1
        for times in self._times:
            times[self._number % _NOTED] = 0
        self._frame[:8].view(np.int64)[0] = self._number
        self._frame[-1] = self._number % 256
        begin = time.monotonic()
        self._show(self._frame)
        return self._number, begin

    def delays(self, number: int, begin: float) -> Iterator[float]:
        """Yield the delay of a frame for each viewer that has seen it."""
        for times in self._times:
            if (arrival := times[number % _NOTED]) > 0:
                yield float(arrival) - begin

    def settle(self) -> None:
        """Wait until no image has arrived for a second, so that the next contestant has quiet."""
        before, end = -1.0, time.monotonic() + SOON
        while (now := max(float(times.max()) for times in self._times)) > before:
            if time.monotonic() > end:
                return
            before = now
            time.sleep(1)

    def wait(self, number: int, begin: float, seconds: float = SOON) -> float:
        """Wait until all have seen a frame; return the longest delay."""
        while len(delays := list(self.delays(number, begin))) < len(self.viewers):
            if time.monotonic() > begin + seconds:
                raise Lost(f"a frame did not arrive within {seconds:g} s")
            time.sleep(1e-4)
        return max(delays)


class Showing(Contestant):
    """A contestant that can send images. Its viewers start with the first image."""

    def __init__(self) -> None:
        super().__init__()
        self._audiences: dict[str, Audience] = {}

    @abstractmethod
    def start_viewer(self, topic: str, path: str) -> int:
        """Start a process that calls a ``Viewer(path)`` with each frame; return its number."""

    @abstractmethod
    def show(self, topic: str, frame: Frame) -> None:
        """Send a frame to the viewers of a topic."""

    def journal_bytes(self) -> int | None:
        """Return the size of the broker's journal; None without a journal."""
        return None

    def _audience(self, topic: str) -> Audience:
        if topic not in self._audiences:
            self._audiences[topic] = Audience(self, topic)
        return self._audiences[topic]

    def image(self, number: int) -> list[float]:
        """Send single images; return the seconds from each call to the receiver's handler."""
        one = self._audience(ONE)
        return [one.wait(*one.send()) for _ in range(number)]

    def stream(self, number: int) -> None:
        """Send images, a few of them at a time."""
        one = self._audience(ONE)
        run_open(number, lambda: partial(one.wait, *one.send()), _UNDERWAY)

    def camera(self, number: int) -> tuple[float | str, ...]:
        """Send *number* images at 30 Hz to three viewers. An image that is overdue is skipped.

        Return the shares of a processor of the broker, the sender and a viewer, the lost and late
        images (in per cent), the median delay of the others (ms), and the journal's growth (MB/s).
        """
        audience = self._audience(THREE)
        processes = [os.getpid(), *audience.viewers, *([self.broker] if self.broker else [])]
        before, journal = [processor_seconds(one) for one in processes], self.journal_bytes()
        begin = time.monotonic()
        sent = list(self._at_30_hz(audience, number))
        while len(delays := _delays(audience, sent)) < len(sent) * len(audience.viewers):
            if time.monotonic() > sent[-1][1] + _LATEST:
                break
            time.sleep(0.01)
        duration = time.monotonic() - begin
        used = [processor_seconds(one) - old for one, old in zip(processes, before, strict=True)]
        sender, *others = [seconds / duration * 100 for seconds in used]
        viewers = len(audience.viewers)
        after = self.journal_bytes()
        audience.settle()
        return (
            others[viewers] if self.broker else "no broker",
            sender,
            sum(others[:viewers]) / viewers,
            100 - 100 * len(delays) / (number * viewers),
            float(np.median(delays)) * 1e3 if delays else "no image arrived",
            "no journal"
            if journal is None or after is None
            else (after - journal) / duration / 1e6,
        )

    def _at_30_hz(self, audience: Audience, number: int) -> Iterator[tuple[int, float]]:
        begin = time.monotonic()
        for one in range(number):
            ahead = begin + one * _PERIOD - time.monotonic()
            if ahead > -_PERIOD:
                time.sleep(max(ahead, 0))
                yield audience.send()


def _delays(audience: Audience, sent: list[tuple[int, float]]) -> list[float]:
    """Return the delays of all images that arrived in time."""
    found = [delay for one in sent for delay in audience.delays(*one)]
    return [delay for delay in found if delay <= _LATEST]
