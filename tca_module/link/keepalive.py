"""Keeps the first connections of modules alive, and tells central when a module was stopped.

One thread does this for all modules of a process. It sleeps until a packet arrives or a check is
due.
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

# seconds between two checks of a connection that its own thread uses, or that gets no answer
TEND_PERIOD = 0.5
# One connection probes a silent central; the others of the process wait this factor longer, so
# that its answer spares their probes.
_OTHERS = 1.2


@dataclass
class Look:
    """One pass of the thread over its modules.

    The modules share when each central was last heard, so only one of them probes it for all.
    """

    now: float
    ready: set[int]  #: the numbers of the files that can be read
    heard: dict[str, float]  #: central's address -> when it was last heard
    #: addresses of the centrals that a module of this pass probes when due
    asked: set[str] = field(default_factory=set)
    #: address of a silent central -> advice for the log
    advice: dict[str, str] = field(default_factory=dict)


class KeepAlive:
    """Keeps the first connection of one module alive, from its creation to ``end``."""

    def __init__(self, link: Connection, stop: Stop, *, reconnect: bool) -> None:
        self.error: CentralLost | None = None  #: the error that ended the module early
        #: silence counts from *since*; the next check is at *due* if nothing arrives
        self.since = self.due = time.monotonic()
        self.files: Collection[int] = ()  #: become readable when something arrives
        self._link = link
        self._reconnect = reconnect
        self._stop = stop  #: set when the module must end
        self._has_told = False  #: the stop has been logged and is passed on to central
        self._warned = False
        self._keeper = _keeper
        self._keeper.add(self)
        stop.wakes(self._keeper.waker.set)

    def end(self) -> None:
        """Stop, because the module's thread leaves and informs central itself. Sets the module's
        stop.
        """
        self._keeper.remove(self)
        self._stop.set()

    def is_due(self, this: Look) -> bool:
        """Return whether there is something to do."""
        is_told = self._has_told or not self._stop.is_set()
        return self.due <= this.now or not this.ready.isdisjoint(self.files) or not is_told

    def look(self, this: Look) -> None:
        """Check the connection and its central, and handle a stop of the module."""
        link, address = self._link, self._link.transport.address
        patience = link.waiting.patience
        if self._stop.is_set() and not self._has_told:
            self._has_told = True
            self._link.log.info(
                "module '%s' has stopped, and handles nothing any more", link.session.module
            )
            link.session.is_to_withdraw = True
            link.transport.wake()  # a thread that waits on the connection then tells central
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
        """Log that central is silent or back; end the module if it does not reconnect."""
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
    """The thread. It runs while there is a module to keep alive."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  #: held during a pass
        self.waker = Waker()
        self._kept: list[KeepAlive] = []
        self._is_running = False

    def add(self, one: KeepAlive) -> None:
        """Keep this module's connection alive from now on."""
        with self._lock:
            self._kept.append(one)
            if not self._is_running:
                self._is_running = True
                threading.Thread(target=self._run, name="keeper", daemon=True).start()
        self.waker.set()

    def remove(self, one: KeepAlive) -> None:
        """Stop doing so."""
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
                self._kept.append(self._kept.pop(0))  # modules take turns to probe central
            ready = self._wait(due, files)

    def _wait(self, due: float, files: Collection[int]) -> set[int]:
        """Wait until a check is due or a file can be read; return the readable files."""
        poll = select.poll()
        for file in (self.waker.fileno(), *files):
            poll.register(file, select.POLLIN)
        ready = poll.poll(max(0.0, 1000 * (due - time.monotonic())) + 1)
        self.waker.clear()
        now = time.monotonic()
        if now - due > STALL:
            with self._lock:
                for one in self._kept:
                    one.since = now  # this process stood still, so central's silence proves nothing
        return {file for file, _ in ready}


_keeper = _Keeper()


def _begin_anew() -> None:
    """Start afresh in a forked child: it has neither the thread nor the modules."""
    global _keeper  # noqa: PLW0603
    _keeper = _Keeper()


os.register_at_fork(after_in_child=_begin_anew)
