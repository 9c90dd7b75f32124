"""Find hung programs: central reports modules that it has lost although they did not leave."""

import os
import socket
import threading
from collections.abc import Callable

from tca_module import MODULE_JOINED, MODULE_LEFT, Arrival, Departure, Module, Task, TcaError
from tca_tools.supervise.supervised import Supervised

_NAME = "tca run"
_RECONNECT_TIME = 2.0
"""Seconds in which a module reconnects if only its connection was cut. A hung module does not."""
_PATIENCE = 60.0
"""Seconds to wait for central."""
_RETRY_SECONDS = 10.0


class HangWatch:
    """Subscribes to central's notices, and kills living programs whose module is lost."""

    def __init__(
        self, address: str, programs: list[Supervised], report: Callable[[str], None]
    ) -> None:
        self._programs = programs
        self._report = report
        #: By the process of a lost module: kills it unless the module joins again in time.
        self._timers: dict[str, threading.Timer] = {}
        self._is_over = threading.Event()
        self._module = Module(_NAME, address)
        self._module.handles(MODULE_LEFT)(self._on_left)
        self._module.handles(MODULE_JOINED)(self._on_joined)
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def start(self) -> None:
        """Start to listen, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop listening, and kill no more programs."""
        self._is_over.set()
        self._module.stop()
        self._thread.join(_RECONNECT_TIME)
        for timer in list(self._timers.values()):
            timer.cancel()

    def _listen(self) -> None:
        while not self._is_over.is_set():
            try:
                self._module.run(patience=_PATIENCE)
            except TcaError as error:
                self._report(f"can't find hung programs: {error}")
                self._is_over.wait(_RETRY_SECONDS)

    def _on_left(self, _: Task, left: Departure) -> None:
        if left.is_lost:
            self._cancel_timer(left.process)
            timer = threading.Timer(_RECONNECT_TIME, self._kill_hung, [left])
            self._timers[left.process] = timer
            timer.start()

    def _on_joined(self, _: Task, joined: Arrival) -> None:
        self._cancel_timer(joined.process)

    def _cancel_timer(self, process: str) -> None:
        if timer := self._timers.pop(process, None):
            timer.cancel()

    def _kill_hung(self, left: Departure) -> None:
        self._timers.pop(left.process, None)
        host, _, number = left.process.rpartition(":")
        if host != socket.gethostname() or not number.isdecimal():
            return
        try:
            group = os.getpgid(int(number))
        except ProcessLookupError:
            return
        for supervised in self._programs:
            if supervised.group == group:
                self._report(
                    f"{supervised.program.name} hangs:"
                    f" central lost its module '{left.module}' ({left.why})"
                )
                supervised.kill_hung()
