"""The local copy of a task's state, and functions to call with each change of it."""

from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from msgspec.structs import replace

from tca_module.checks import check_function
from tca_module.errors import Timeout
from tca_module.following.observation import Observation, ObservedChange, is_progress
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_wire.packets.changes import Observe
from tca_wire.vocabulary import Party

C = TypeVar("C")


class Mirror(Observation):
    """An observation of one task, with the newest state that this program has received."""

    def __init__(self, connection: Connection, header: Observe, what: object) -> None:
        super().__init__(connection, header, what)
        self.serial = -1
        self.has_ended = False  #: whether the task has ended
        self._first_serial = -1  # where following began
        self.newest: ObservedChange | None = None  #: the newest change, or the first state
        self.progress: ObservedChange | None = None  #: the newest intermediate result
        self.has_progressed = False  #: whether the newest change brought an intermediate result

    def _process_change(self, observed: ObservedChange) -> None:
        if self.newest is None:
            self._first_serial = observed.change.serial
        self.newest, self.has_ended = observed, observed.change.is_over
        # Central sends no serial number for a task that had ended.
        self.serial = max(self.serial, observed.change.serial)
        self._update_progress(observed)
        super()._process_change(observed)

    def _update_progress(self, observed: ObservedChange) -> None:
        """Store a new intermediate result.

        After a broken connection, central's snapshot may contain a result that is known already.
        """
        change = observed.change
        known = self.progress.change.data if self.progress is not None else b""
        self.has_progressed = is_progress(observed) and not (
            change.is_late and change.data == known
        )
        if self.has_progressed:
            self.progress = observed

    def snapshot(self) -> ObservedChange | None:
        """Return the task's present state as a change; None while the task is in its first state.

        The change has the form of a change in a snapshot of central. Earlier changes that this
        program has followed count as missed.
        """
        if self.newest is None or self.newest.change.serial == 0:
            return None
        change = self.newest.change
        if not change.is_over:
            data = self.progress.change.data if self.progress is not None else b""
            change = replace(change, by=Party.CENTRAL, module="", text="", data=data)
        change = replace(change, transition="", is_late=True)
        return self.newest._replace(
            change=change, missed=max(0, change.serial - self._first_serial - 1)
        )

    @property
    def state(self) -> str:
        """The newest state. Waits for central's snapshot the first time.

        Raises what ``Observation.wait`` does, or Timeout.
        """
        self.catch_up()
        if not self.has_ended:
            if not (self.is_complete or self.wait(lambda: self.is_complete, ACKNOWLEDGED_WITHIN)):
                raise Timeout(f"{self._what} was not reported within {ACKNOWLEDGED_WITHIN:g} s")
            self.check()
        return self._state

    @property
    def _state(self) -> str:
        return self.newest.change.state if self.newest is not None else ""

    @property
    def known_state(self) -> str:
        """The newest state; "" if central has not reported it yet. Never waits."""
        self.catch_up()
        return self._state if self.is_complete else ""


class ChangeCallback(Generic[C]):
    """A function that is called with changes of tasks; ``on_change()`` returns it.

    The thread that called ``on_change()`` calls the function, while it waits for central or for its
    next message. Only one callback runs at a time. Errors in the function are logged.

    Attributes:
        is_over: whether ``cancel()`` has ended the calls.
    """

    def __init__(
        self,
        what: str,
        connection: Connection,
        function: Callable[..., object],
        convert: Callable[[ObservedChange], C],
    ) -> None:
        self.is_over = False
        self._arguments = check_function(what, function, "(sender, change) or (change)", (2, 1))
        self._connection = connection
        self._function = function
        self._convert = convert

    def put(self, observed: ObservedChange) -> None:
        """Schedule a call of the function with a change."""
        if not self.is_over:
            self._connection.wait_loop.callbacks.append(partial(self._call, observed))

    def cancel(self) -> None:
        """End the calls, from any thread. Canceling again does nothing."""
        self.is_over = True

    def _call(self, observed: ObservedChange) -> None:
        if not self.is_over:
            arguments = (self._connection.root_sender, self._convert(observed))[-self._arguments :]
            name = getattr(self._function, "__qualname__", self._function)
            self._connection.call_back(partial(self._function, *arguments), name)
