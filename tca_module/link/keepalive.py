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
CHECK_PERIOD = 0.5
# One connection probes a silent central first. The other connections of the process wait longer, by
# this factor. The answer to the first probe makes their probes unnecessary.
_LATER_PROBES = 1.2


@dataclass
class Pass:
    """One pass of the thread over its modules.

    The modules share the time at which each central was last heard. So only one module probes a
    central for all.
    """

    now: float
    ready: set[int]  #: the numbers of the files that can be read
    heard: dict[str, float]  #: central's address -> when it was last heard
    #: addresses of the centrals that a module of this pass probes when due
    probed: set[str] = field(default_factory=set)
    #: address of a silent central -> advice for the log
    advice: dict[str, str] = field(default_factory=dict)


class KeepAlive:
    """Keeps the first connection of one module alive, from its creation to ``end``."""

    def __init__(self, link: Connection, stop: Stop, *, reconnect: bool) -> None:
        self.error: CentralLost | None = None  #: the error that ended the module early
        self.since = time.monotonic()  #: the earliest time from which central's silence counts
        self.due = self.since  #: when the next check is, if nothing arrives
        self.files: Collection[int] = ()  #: one becomes readable when something arrives
        self._link = link
        self._reconnect = reconnect
        self._stop = stop  #: set when the module must end
        self._has_reported_stop = False  #: whether the stop is logged and passed on to central
        self._has_warned = False  #: whether the log says that central does not answer
        self._thread = _thread
        self._thread.add(self)
        stop.on_set(self._thread.waker.set)

    def end(self) -> None:
        """End the keep-alive, and set the module's stop. The module's thread informs central."""
        self._thread.remove(self)
        self._stop.set()

    def is_due(self, current: Pass) -> bool:
        """Return whether there is something to do."""
        if self._stop.is_set() and not self._has_reported_stop:
            return True
        return self.due <= current.now or not current.ready.isdisjoint(self.files)

    def check(self, current: Pass) -> None:
        """Check the connection and its central, and handle a stop of the module."""
        link, address = self._link, self._link.transport.address
        patience = link.wait_loop.patience
        if self._stop.is_set() and not self._has_reported_stop:
            self._has_reported_stop = True
            name = link.session.module
            link.log.info("module '%s' has stopped and handles no more messages", name)
            link.session.is_to_withdraw = True
            link.transport.wake()  # a thread that waits on the connection then tells central
        since = max(self.since, current.heard.get(address, self.since))
        quiet = quiet_within(patience, is_idle=True)
        if address in current.probed:
            quiet *= _LATER_PROBES
        result = link.keep_alive_if_idle(since, quiet)
        current.heard[address] = max(since, link.session.heard)
        if result is None:  # its own thread uses the connection
            self.files, self.due = (), current.now + CHECK_PERIOD
            return
        current.probed.add(address)
        silence, seconds = result
        is_silent = silence >= patience
        self.files = link.transport.files()
        self.due = current.now + (
            seconds if link.session.is_welcome and not is_silent else CHECK_PERIOD
        )
        self._report(current, is_silent=is_silent)

    def _report(self, current: Pass, *, is_silent: bool) -> None:
        """Log that central is silent or back. End a module that must not wait for central."""
        link, address = self._link, self._link.transport.address
        if is_silent and not self._reconnect and not self._stop.is_set():
            module, lost = link.session.module, link.line.lost_error()
            self.error = CentralLost(f"module '{module}': {lost}")
            link.log.error("module '%s' ends: %s", module, lost)
            self._stop.set()
        elif is_silent and not self._has_warned:
            if address not in current.advice:
                current.advice[address] = link.line.advice()
            advice = current.advice[address]
            where = link.line.where
            link.log.warning("central at %s does not answer; trying again: %s", where, advice)
        elif not is_silent and self._has_warned:
            link.log.warning("central at %s is back", address)
        self._has_warned = is_silent


class _KeepAliveThread:
    """The one thread of the process for all modules. It runs while there is a module."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  #: held during a pass
        self.waker = Waker()
        self._modules: list[KeepAlive] = []
        self._is_running = False

    def add(self, module: KeepAlive) -> None:
        """Keep a module's connection alive from now on."""
        with self._lock:
            self._modules.append(module)
            if not self._is_running:
                self._is_running = True
                threading.Thread(target=self._run, name="keep-alive", daemon=True).start()
        self.waker.set()

    def remove(self, module: KeepAlive) -> None:
        """Keep a module's connection alive no longer."""
        with self._lock:
            self._modules.remove(module)
        self.waker.set()

    def _run(self) -> None:
        heard: dict[str, float] = {}
        ready: set[int] = set()
        while True:
            with self._lock:
                current = Pass(time.monotonic(), ready, heard)
                for module in self._modules:
                    if module.is_due(current):
                        module.check(current)
                if not self._modules:
                    self._is_running = False
                    return
                due = min(module.due for module in self._modules)
                files = {file for module in self._modules for file in module.files}
                self._modules.append(self._modules.pop(0))  # modules take turns to probe central
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
                for module in self._modules:
                    module.since = (
                        now  # this process stood still, so central's silence proves nothing
                    )
        return {file for file, _ in ready}


_thread = _KeepAliveThread()


def _reset_after_fork() -> None:
    """Start afresh in a forked child: it has neither the thread nor the modules."""
    global _thread  # noqa: PLW0603
    _thread = _KeepAliveThread()


os.register_at_fork(after_in_child=_reset_after_fork)
