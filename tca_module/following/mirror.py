"""A task as a program that follows it knows it: the newest state, and functions to call with each
change.
"""

from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from msgspec.structs import replace

from tca_module.checks import check_function
from tca_module.errors import Timeout
from tca_module.following.observation import News, Observation, is_progress
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_wire.packets.changes import Observe
from tca_wire.vocabulary import Party

C = TypeVar("C")


class Mirror(Observation):
    """An observation of one task, with its newest state as far as this program has heard."""

    def __init__(self, connection: Connection, header: Observe, what: object) -> None:
        super().__init__(connection, header, what)
        self.serial = -1
        self.has_ended = False  #: the task
        self.newest: News | None = None  #: the newest change, or how it stands
        self.progress: News | None = None  #: the newest intermediate result
        self.has_progressed = False  #: with the newest change

    def _hear(self, news: News) -> None:
        self.newest, self.has_ended = news, news.change.is_over
        self.serial = max(
            self.serial, news.change.serial
        )  # of one that had ended central does not know it
        self._hear_progress(news)
        super()._hear(news)

    def _hear_progress(self, news: News) -> None:
        """After a break central tells how the task stands, with the intermediate result that may be
        known already.
        """
        change, known = news.change, self.progress.change.data if self.progress is not None else b""
        self.has_progressed = is_progress(news) and not (change.is_late and change.data == known)
        if self.has_progressed:
            self.progress = news

    def as_it_stands(self) -> News | None:
        """How the task stands, in the form in which central tells it late; None while it is in its
        first state.
        """
        if self.newest is None or self.newest.change.serial == 0:
            return None
        change = self.newest.change
        if not change.is_over:
            data = self.progress.change.data if self.progress is not None else b""
            change = replace(change, by=Party.CENTRAL, module="", text="", data=data)
        return self.newest._replace(change=replace(change, transition="", is_late=True), missed=0)

    @property
    def state(self) -> str:
        """The newest state. Waits for central's word until that has come once. Raises what
        ``Observation.wait`` does, or Timeout.
        """
        self.catch_up()
        if not self.has_ended:
            if not (self.is_complete or self.wait(lambda: self.is_complete, ACKNOWLEDGED_WITHIN)):
                raise Timeout(f"{self._what} was not told within {ACKNOWLEDGED_WITHIN:g} s")
            self.check()
        return self._state

    @property
    def _state(self) -> str:
        return self.newest.change.state if self.newest is not None else ""

    @property
    def known(self) -> str:
        """The newest state; "" if it was not told yet. Never waits."""
        self.catch_up()
        return self._state if self.is_complete else ""


class ChangeCallback(Generic[C]):
    """A function that is called with changes of tasks: in the thread that asked for that, one call
    at a time, while it waits for central or its next message. Errors in it are logged.
    """

    def __init__(
        self,
        what: str,
        connection: Connection,
        function: Callable[..., object],
        give: Callable[[News], C],
    ) -> None:
        self.is_over = False  #: it is called no more
        self._arguments = check_function(what, function, "(sender, change) or (change)", (2, 1))
        self._connection = connection
        self._function = function
        self._give = give

    def put(self, news: News) -> None:
        """Something has changed: call the function soon."""
        if not self.is_over:
            self._connection.waiting.callbacks.append(partial(self._call, news))

    def cancel(self) -> None:
        """Call it no more; from any thread. Twice does no harm."""
        self.is_over = True

    def _call(self, news: News) -> None:
        if not self.is_over:
            given = (self._connection.root_sender, self._give(news))[-self._arguments :]
            name = getattr(self._function, "__qualname__", self._function)
            self._connection.call_back(partial(self._function, *given), name)
