"""A central behind a real socket, in a thread of the tests, with the facts that it recorded."""

import queue
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import pytest

from tca_central.core import Central
from tca_central.events import Effect, Record
from tca_central.shell.gate import Gate as EntranceGate
from tca_central.shell.server import Daemon
from tca_module.link import wait_loop
from tca_module.serving import event_loop

SOON = 10.0


class Gate:
    """A handler that signals its start, and returns when ``go_on`` is set."""

    def __init__(self, result: Any = None) -> None:
        self.result = result
        self.begun, self.go_on = threading.Event(), threading.Event()
        self.threads = queue.SimpleQueue[str]()  #: the names of the threads that called the handler

    def __call__(self, *_: Any) -> Any:
        self.threads.put(threading.current_thread().name)
        self.begun.set()
        assert self.go_on.wait(SOON)
        return self.result


class _RecordingDaemon(Daemon):
    def __init__(self, epoch: str, address: str, gate: EntranceGate | None) -> None:
        super().__init__(Central(epoch), address, gate=gate)
        self.recorded: list[Any] = []

    def _perform(self, effects: list[Effect]) -> None:
        self.recorded += [
            fact for effect in effects if isinstance(effect, Record) for fact in effect.entry.facts
        ]
        super()._perform(effects)


class RealCentral:
    """A running central."""

    def __init__(self, address: str, epoch: str = "real", gate: EntranceGate | None = None) -> None:
        self.server = _RecordingDaemon(epoch, address, gate)
        self.address = self.server.endpoint
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        self.server.serve()
        self.server.close()

    def facts(self, kind: type) -> list[Any]:
        """Return all facts of a kind that were recorded so far."""
        return [fact for fact in self.server.recorded[:] if isinstance(fact, kind)]

    def open_requests_of(self, module: str) -> list[Any]:
        """Return the open requests of a module's handlers."""
        connections = list(self.server.central.registry.connections.values())
        return [
            due
            for one in connections
            if one.module.name == module
            for due in list(one.outstanding.values())
        ]

    def close(self) -> None:
        if self._thread.is_alive():
            self.server.stop("the test ends")
            self._thread.join(SOON)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def until(condition: Callable[[], Any], description: str, seconds: float = SOON) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {description}"
        time.sleep(0.005)


def disable_polling(patch: pytest.MonkeyPatch) -> None:
    """Stop the polling every STEP, so that a wait that misses a wake-up lasts for ever."""
    for where in (wait_loop, event_loop):
        patch.setattr(where, "STEP", 10 * SOON)
