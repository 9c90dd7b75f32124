"""Programs that stand still: central tells of those that it hears nothing from though they have not
said goodbye.
"""

import os
import socket
import threading
from collections.abc import Callable

from tca_module import MODULE_JOINED, MODULE_LEFT, Arrival, Departure, Module, Task, TcaError
from tca_tools.supervise.supervised import Supervised

_NAME = "tca run"
_COMES_BACK = 2.0
"""Seconds within which a module whose line was cut is there again; one that stands still is not."""
_PATIENCE = 60.0
_AGAIN = 10.0


class Silences:
    """Listens to central's notices, and has those programs killed that it has lost and that live
    on.
    """

    def __init__(
        self, address: str, programs: list[Supervised], tell: Callable[[str], None]
    ) -> None:
        self._programs = programs
        self._tell = tell
        self._lost: dict[
            str, threading.Timer
        ] = {}  #: by process, what is to be done if it stays away
        self._over = threading.Event()
        self._module = Module(_NAME, address)
        self._module.handles(MODULE_LEFT)(self._on_left)
        self._module.handles(MODULE_JOINED)(self._on_joined)
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def end(self) -> None:
        """Listen no more."""
        self._over.set()
        self._module.stop()
        self._thread.join(_COMES_BACK)
        for timer in list(self._lost.values()):
            timer.cancel()

    def _listen(self) -> None:
        while not self._over.is_set():
            try:
                self._module.run(patience=_PATIENCE)
            except TcaError as error:
                self._tell(f"can't hear whether programs hang: {error}")
                self._over.wait(_AGAIN)

    def _on_left(self, _: Task, left: Departure) -> None:
        if left.is_lost:
            self._forget(left.process)
            self._lost[left.process] = threading.Timer(_COMES_BACK, self._is_hung, [left])
            self._lost[left.process].start()

    def _on_joined(self, _: Task, joined: Arrival) -> None:
        self._forget(joined.process)

    def _forget(self, process: str) -> None:
        if timer := self._lost.pop(process, None):
            timer.cancel()

    def _is_hung(self, left: Departure) -> None:
        self._lost.pop(left.process, None)
        host, _, number = left.process.rpartition(":")
        if host != socket.gethostname() or not number.isdecimal():
            return
        try:
            group = os.getpgid(int(number))
        except ProcessLookupError:
            return
        for kept in self._programs:
            if kept.group == group:
                self._tell(
                    f"{kept.program.name} hangs: central lost its module '{left.module}' ({left.why})"
                )
                kept.kill_hung()
