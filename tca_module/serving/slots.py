"""The threads of a module: as many for each resource as its capacity, one of which calls the resource's callbacks."""

import logging
import threading
import time
from collections.abc import Callable, Sequence

from tca_module.errors import MisuseError
from tca_module.serving.callbacks import Callbacks
from tca_module.serving.slot import Slot

_PATIENCE = 1.0
"""Seconds that handlers have for their end before it is said that they are waited for."""

CALLBACKS = "callbacks"
"""The resource whose thread calls the callbacks for which no other is named."""

OpenSlot = Callable[[int, str, Callbacks], Slot]
"""Opens the slot of that number (from 1) for a resource."""


class Slots:
    """The slots of a module while it runs, and its callbacks at any time."""

    def __init__(self, module: str) -> None:
        self._module = module
        self._log = logging.getLogger(f"tca.{module}")
        self._callbacks: dict[str, Callbacks] = {}  #: by resource
        self._lock = threading.Lock()
        self._slots: list[Slot] = []
        self._threads: set[str] = set()  #: resources that have a thread
        self._open_slot: OpenSlot | None = None  #: while the module runs

    def open(self, resources: Sequence[str], open_slot: OpenSlot) -> None:
        """Open a slot for each of these resources, and wait until messages are handled. Raises what prevents it."""
        with self._lock:
            self._open_slot = open_slot
            for resource in resources:
                self._open(resource, open_slot)
            opened = list(self._slots)
        for slot in opened:
            slot.wait_until_open()

    def close(self, why: BaseException | None) -> list[BaseException]:
        """Wait until all slots have ended; the errors that ended some early. A long wait is logged, with *why* the
        module ends.
        """
        with self._lock:
            self._open_slot = None
        patience = time.monotonic() + _PATIENCE
        for slot in self._slots:
            if not slot.join(max(0.0, patience - time.monotonic())):
                self._log.warning(
                    "module '%s' ends%s, and waits for its handler of '%s' to return, which may look at task.cancelled",
                    self._module, f" ({type(why).__name__}: {why})" if why is not None else "", slot.handling,
                )  # fmt: skip
                slot.join()
        errors = [slot.error for slot in self._slots if slot.error is not None]
        self._slots.clear()
        self._threads.clear()
        return errors

    def has_callbacks(self, resource: str) -> bool:
        """Whether something is to be called by a resource's thread."""
        return bool(self._callbacks.get(resource))

    def callbacks(self, resource: str) -> Callbacks:
        """The callbacks of a resource's thread, started if the module runs. Raises MisuseError if it can't be."""
        with self._lock:
            if self._open_slot is not None and resource not in self._threads:
                if resource != CALLBACKS:
                    msg = f"resource '{resource}' of module '{self._module}' has no thread: before run(), declare what \
it handles or calls"
                    raise MisuseError(msg)
                self._open(resource, self._open_slot)
            return self._callbacks.setdefault(resource, Callbacks(self._module))

    def _open(self, resource: str, open_slot: OpenSlot) -> None:
        callbacks = Callbacks(self._module)  # of a further thread of the resource: it has none to call
        if resource not in self._threads:
            callbacks = self._callbacks.setdefault(resource, callbacks)
        self._threads.add(resource)
        self._slots.append(open_slot(len(self._slots) + 1, resource, callbacks))
