"""The thread that keeps a module's first connection alive, and tells central when the module was stopped."""

import logging
import threading
import time

from tca_module.errors import NoCentral
from tca_module.link.connection import Connection
from tca_module.link.packet_line import STALL

TEND_PERIOD = 0.5  # seconds between two looks at the connection


class KeepAlive:
    """The thread; runs from its creation to ``end``."""

    def __init__(self, link: Connection, patience: float, stop: threading.Event, *, reconnect: bool) -> None:
        self.error: NoCentral | None = None  #: the error that ended the module before its time
        self._link = link
        self._patience = patience
        self._reconnect = reconnect
        self._stop = stop  #: the module is to end
        self._is_left = threading.Event()  #: its thread leaves
        self._since = self._looked = time.monotonic()
        self._warned = False
        self._log = logging.getLogger(f"tca.{link.session.module}")
        self._thread = threading.Thread(target=self._run, name=f"{link.session.module} keeper", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End it, because the module's thread leaves and tells central itself. Sets *stop*."""
        self._is_left.set()
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(TEND_PERIOD):
            self._tend()
        if self._is_left.is_set():
            return
        self._log.info("module '%s' has stopped, and handles nothing any more", self._link.session.module)
        self._link.session.is_to_withdraw = True
        self._link.transport.wake()  # the thread that waits on the connection reports it
        self._tend()
        while not self._is_left.wait(TEND_PERIOD):
            self._tend()

    def _tend(self) -> None:
        link, silence = self._link, self._link.tend(self._since)
        before, self._looked = self._looked, time.monotonic()
        if self._looked - before > STALL:
            self._since = self._looked  # it was this process that stood still
            return
        if silence > self._patience and not self._reconnect and not self._stop.is_set():
            module, lost = link.session.module, link.line.lost()
            self.error = NoCentral(f"module '{module}': {lost}")
            self._log.error("module '%s' ends: %s", module, lost)
            self._stop.set()
        elif silence > self._patience and not self._warned:
            self._log.warning(
                "central at %s does not answer, and is tried again: %s", link.transport.address, link.line.what_to_do()
            )
        elif silence <= self._patience and self._warned:
            self._log.warning("central at %s is back", link.transport.address)
        self._warned = silence > self._patience
