"""Keeps the first connections of modules alive, and tells central when a module was stopped.

One thread does so for all modules of a process. It sleeps until something arrives, or is due.
"""

import os
import select
import threading
import time
from collections.abc import Collection
from dataclasses import dataclass, field

from tca_module.errors import CentralLost
from tca_module.link.connection import Connection
from tca_module.link.packet_line import STALL
from tca_module.link.stop import Stop
from tca_module.session.session import quiet_within
from tca_module.sockets.transport import Waker

TEND_PERIOD = 0.5  # seconds between two looks at a connection that its own thread uses, or that central does not answer
_OTHERS = 1.2  # so many times as long as the first one the others wait for a word from central before they ask, too


@dataclass
class Look:
    """One look of the thread at its modules. They share what they hear of a central: one of them
    asks it for all.
    """

    now: float
    ready: set[int]  #: the files that can be read
    heard: dict[str, float]  #: when a central, by its address, last said anything
    asked: set[str] = field(default_factory=set)  #: centrals that one of them asks when that is due
    advice: dict[str, str] = field(
        default_factory=dict
    )  #: what to do about one that does not answer


class KeepAlive:
    """Keeps the first connection of one module alive, from its creation to ``end``."""

    def __init__(self, link: Connection, stop: Stop, *, reconnect: bool) -> None:
        self.error: CentralLost | None = None  #: the error that ended the module before its time
        #: silence counts from then; when to look again if nothing arrives
        self.since = self.due = time.monotonic()
        self.files: Collection[int] = ()  #: those that tell of something
        self._link = link
        self._reconnect = reconnect
        self._stop = stop  #: the module is to end
        self._has_told = False  #: that it is stopped
        self._warned = False
        self._keeper = _keeper
        self._keeper.add(self)
        stop.wakes(self._keeper.waker.set)

    def end(self) -> None:
        """End it, because the module's thread leaves and tells central itself. Sets *stop*."""
        self._keeper.remove(self)
        self._stop.set()

    def is_due(self, this: Look) -> bool:
        """Whether there is something to do."""
        is_told = self._has_told or not self._stop.is_set()
        return self.due <= this.now or not this.ready.isdisjoint(self.files) or not is_told

    def look(self, this: Look) -> None:
        """Do what is due."""
        link, address, patience = (
            self._link,
            self._link.transport.address,
            self._link.waiting.patience,
        )
        if self._stop.is_set() and not self._has_told:
            self._has_told = True
            self._link.log.info(
                "module '%s' has stopped, and handles nothing any more", link.session.module
            )
            link.session.is_to_withdraw = True
            link.transport.wake()  # if its thread waits on the connection, that reports it
        since = max(self.since, this.heard.get(address, self.since))
        quiet = quiet_within(patience, is_idle=True)
        kept = link.keep(since, quiet * _OTHERS if address in this.asked else quiet)
        this.heard[address] = max(since, link.session.heard)
        if kept is None:
            self.files, self.due = (), this.now + TEND_PERIOD
            return
        this.asked.add(address)
        silence, seconds = kept
        is_silent = silence >= patience
        self.files = link.transport.files()
        self.due = this.now + (
            seconds if link.session.is_welcome and not is_silent else TEND_PERIOD
        )
        self._tell(this, is_silent=is_silent)

    def _tell(self, this: Look, *, is_silent: bool) -> None:
        link, address = self._link, self._link.transport.address
        if is_silent and not self._reconnect and not self._stop.is_set():
            module, lost = link.session.module, link.line.lost()
            self.error = CentralLost(f"module '{module}': {lost}")
            self._link.log.error("module '%s' ends: %s", module, lost)
            self._stop.set()
        elif is_silent and not self._warned:
            if address not in this.advice:
                this.advice[address] = link.line.what_to_do()
            link.log.warning(
                "central at %s does not answer, and is tried again: %s",
                address,
                this.advice[address],
            )
        elif not is_silent and self._warned:
            self._link.log.warning("central at %s is back", address)
        self._warned = is_silent


class _Keeper:
    """The thread, while there is something to keep alive."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  #: held while connections are looked at
        self.waker = Waker()
        self._kept: list[KeepAlive] = []
        self._is_running = False

    def add(self, one: KeepAlive) -> None:
        """From now on look after this."""
        with self._lock:
            self._kept.append(one)
            if not self._is_running:
                self._is_running = True
                threading.Thread(target=self._run, name="keeper", daemon=True).start()
        self.waker.set()

    def remove(self, one: KeepAlive) -> None:
        """Look after it no longer."""
        with self._lock:
            self._kept.remove(one)
        self.waker.set()

    def _run(self) -> None:
        heard: dict[str, float] = {}
        ready: set[int] = set()
        while True:
            with self._lock:
                this = Look(time.monotonic(), ready, heard)
                for one in self._kept:
                    if one.is_due(this):
                        one.look(this)
                if not self._kept:
                    self._is_running = False
                    return
                due = min(one.due for one in self._kept)
                files = {file for one in self._kept for file in one.files}
                self._kept.append(self._kept.pop(0))  # they take turns to ask
            ready = self._wait(due, files)

    def _wait(self, due: float, files: Collection[int]) -> set[int]:
        """Wait until something is due, or can be read; the files that can be."""
        poll = select.poll()
        for file in (self.waker.fileno(), *files):
            poll.register(file, select.POLLIN)
        ready = poll.poll(max(0.0, 1000 * (due - time.monotonic())) + 1)
        self.waker.clear()
        now = time.monotonic()
        if now - due > STALL:
            with self._lock:
                for one in self._kept:
                    one.since = now  # it was this process that stood still
        return {file for file, _ in ready}


_keeper = _Keeper()


def _begin_anew() -> None:
    """A forked child has none of the threads, nor of the modules."""
    global _keeper  # noqa: PLW0603
    _keeper = _Keeper()


os.register_at_fork(after_in_child=_begin_anew)
