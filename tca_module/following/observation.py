"""The changes of tasks' states, as central reports them: in order, each once, with missed counts.

Central first sends a snapshot: the present state of each living task. Then it sends each change.
After its restart, and after a broken connection, it sends a snapshot again. Tasks that are missing
in it have ended in the meantime.
"""

import weakref
from collections import deque
from collections.abc import Callable, Generator
from contextlib import suppress
from typing import Any, NamedTuple

import msgspec

from tca_module.errors import CentralLost, Deadlock, Refused
from tca_module.link.connection import Connection
from tca_module.session.epoch_numbers import with_epoch
from tca_module.session.request import Request
from tca_module.session.sent_tasks import SentId
from tca_wire.packets.changes import Observe
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Party, Refusal

MOST_UNREAD = 10_000
"""The number of changes that wait to be read; the oldest ones beyond it count as missed."""

_ENDED_UNSEEN = "it ended while this program did not hear central"

_decode = msgspec.msgpack.Decoder(StateChange).decode


class ObservedChange(NamedTuple):
    """A change of a task's state, as this program received it."""

    change: StateChange
    task: TaskId
    missed: int
    """The number of changes before it that this program did not receive."""


def is_progress(observed: ObservedChange) -> bool:
    """Whether the data of a change are an intermediate result."""
    change = observed.change
    return bool(change.data) and not change.is_over and change.by is not Party.CLIENT


Wants = Callable[[ObservedChange], bool]


class UnreadChanges:
    """The wanted changes that a reader has not read yet, from its creation on."""

    def __init__(self, wants: Wants) -> None:
        self._wants = wants
        self._unread: deque[ObservedChange] = deque()
        self._dropped: dict[int, int] = {}  #: by task: the number of dropped changes

    def __bool__(self) -> bool:
        return bool(self._unread)

    def add(self, observed: ObservedChange) -> None:
        """Add a change if the reader wants it. Drops the oldest one if there are too many."""
        if not self._wants(observed):
            return
        self._unread.append(observed)
        if len(self._unread) > MOST_UNREAD:
            oldest = self._unread.popleft()
            self._dropped[oldest.task] = self._dropped.get(oldest.task, 0) + oldest.missed + 1

    def add_first(self, observed: ObservedChange) -> None:
        """Add the first change, which arrived before this was created."""
        self._unread.append(observed)

    def clear(self) -> None:
        """Forget the unread changes."""
        self._unread.clear()

    def pop(self) -> ObservedChange:
        """Remove and return the oldest change. Dropped ones count as missed."""
        observed = self._unread.popleft()
        return observed._replace(missed=observed.missed + self._dropped.pop(observed.task, 0))


class _LastChange(NamedTuple):
    """The part of a task's newest change that may be needed later."""

    serial: int
    message: str
    goal: bytes


class Observation:
    """A request for the changes of some tasks' states.

    It ends when it is garbage collected, unless functions are called with the changes.
    """

    def __init__(self, connection: Connection, header: Observe, what: object) -> None:
        self.connection = connection
        # They are called with a change before the readers get it.
        self._functions: list[Callable[[ObservedChange], object]] = []
        self._what = what  # for errors
        self._header = header
        self._readers: weakref.WeakSet[UnreadChanges] = weakref.WeakSet()
        self._calls_functions = False
        # The newest changes of living tasks; empty if only some states are observed.
        self._known: dict[int, _LastChange] = {}
        self._in_snapshot: set[int] = set()  # the tasks in the present snapshot
        self._snapshot_source = ("", 0)  # the epoch, and the request, of the present snapshot
        self._has_snapshot = False  # a snapshot has arrived whole
        self._is_given_up = False
        self.request = self._send_request()  #: the present one

    def _send_request(self) -> Request:
        request = self.connection.request(self._header, wants_answer=True)
        abandon, reference = self.connection.abandon, weakref.ref(self)

        # It holds no strong reference, so that an unused observation is collected.
        def on_answer() -> None:
            if (observation := reference()) is not None:
                observation._process_answers()  # noqa: SLF001
            elif not request.is_over:
                abandon(request)

        request.notify = self._process_answers if self._calls_functions else on_answer
        return request

    def call(self, function: Callable[[ObservedChange], object]) -> None:
        """Call a function with all changes from now on, until the end or ``close()``."""
        self._functions.append(function)
        self._calls_functions = True
        self.request.notify = self._process_answers

    # --- reading ----------------------------------------------------------------------------------

    @property
    def is_complete(self) -> bool:
        """Whether the present states of all observed tasks are known."""
        return self._has_snapshot or self.is_over

    @property
    def is_over(self) -> bool:
        """Whether no more changes will arrive."""
        return self.request.is_over and not self.request.answers

    def unread(self, wants: Wants = lambda _: True) -> UnreadChanges:
        """Return a place for the wanted changes from now on."""
        unread = UnreadChanges(wants)
        self._readers.add(unread)
        return unread

    def remove_reader(self, reader: UnreadChanges) -> None:
        """Add no more changes for this reader."""
        self._readers.discard(reader)
        reader.clear()

    def wait(self, is_there: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *is_there* returns true, or no more can arrive. Returns its value.

        Raises what ``Connection.wait`` does.
        """
        self.catch_up()
        if not is_there():
            try:
                self.connection.wait(
                    self.request, timeout, self._what, lambda: self._is_settled(is_there)
                )
            except BaseException as error:
                self._on_error(error)
                raise
        self._call_functions()
        return is_there()

    def until(self, is_there: Callable[[], bool]) -> Generator[Any, None, bool]:
        """Do the same for a coroutine, which awaits it; ``asyncio.timeout`` limits the wait."""
        self.catch_up()
        if not is_there():
            try:
                yield from self.connection.until_over(
                    self.request, self._what, lambda: self._is_settled(is_there)
                )
            except Deadlock as error:
                self._on_error(error)
                raise
            except CentralLost:
                self._discard_lost_send()
                raise
        self._call_functions()
        return is_there()

    def receive_end(self) -> None:
        """Receive the end of all observed tasks, which central reports at this time.

        Functions are called with it before the caller continues.
        """
        if self._calls_functions:
            self.connection.wait_for_end(self.request)

    def _call_functions(self) -> None:
        """Call functions with the changes that the caller knows, before it continues."""
        if self._calls_functions:
            self.connection.process_pending()

    def _on_error(self, error: BaseException) -> None:
        """Send the request again after a wait that ended with an error.

        The wait has given the request up, or central has, since it could never end. The new request
        is sent at once if functions are called, otherwise at the next use.
        """
        self._is_given_up = not self.request.is_over or isinstance(error, Deadlock)
        if self._is_given_up and self._calls_functions:
            with suppress(CentralLost):
                self._is_given_up, self.request = False, self._send_request()
        if isinstance(error, CentralLost):
            self._discard_lost_send()

    def _discard_lost_send(self) -> None:
        """Drop the report that the task was lost: the user gets it as an error now."""
        if isinstance(self._header.task, SentId):
            self.connection.session.sends.discard(self._header.task.request)

    def _is_settled(self, is_there: Callable[[], bool]) -> bool:
        self._process_answers()
        return is_there() or self.is_over

    def catch_up(self) -> None:
        """Process what has arrived. Sends the request again if it was given up. Never waits."""
        if self._is_given_up:
            self._is_given_up, self.request = False, self._send_request()
        self.connection.catch_up()
        self._process_answers()

    def nudge(self) -> None:
        """Wake a coroutine that waits, so that it checks again."""
        if self.request.wake is not None:
            self.request.wake()

    def check(self) -> None:
        """Raise the error that the request ended with, if any."""
        self.request.check(self._what)

    def close(self) -> None:
        """End the observation."""
        if not self.request.is_over:
            self.connection.abandon(self.request)
        self.request.is_over, self._is_given_up = True, False
        self.request.notify = None
        self.request.answers.clear()

    # --- answers of central -----------------------------------------------------------------------

    def _process_answers(self) -> None:
        while self.request.answers:
            answer, body = self.request.answers.popleft()
            if body:
                self._on_change(_decode(body))
            elif answer.more:
                self._on_snapshot_end()
        refused = self.request.refused
        # A refused wait is an error of the waiting caller only.
        is_refused_wait = refused is not None and refused.refusal is Refusal.DEADLOCK
        if self._calls_functions and self.request.has_failed and not is_refused_wait:
            self._calls_functions = False
            try:
                self.check()
            except (CentralLost, Refused) as error:  # logged: no caller could catch it
                text = f"{error}; functions are not called with it any more"
                self.connection.log.error("%s", text)  # noqa: TRY400

    def _on_change(self, change: StateChange) -> None:
        if change.is_late:
            self._start_snapshot()
            self._in_snapshot.add(change.task)
        known = self._known.get(change.task)
        if known is not None and 0 <= change.serial <= known.serial:
            return  # received before, or older than the newest change
        if change.is_over:
            self._known.pop(change.task, None)
        elif not self._header.states:
            self._known[change.task] = _LastChange(change.serial, change.message, change.goal)
        self._publish(change, max(0, change.serial - known.serial - 1) if known is not None else 0)

    def _start_snapshot(self) -> None:
        """Start a snapshot, unless it has started: it has its central and its request."""
        epoch, number = self.connection.session.epoch, self.request.header.number
        if (epoch, number) != self._snapshot_source:
            if epoch != self._snapshot_source[0]:
                self._publish_ends(list(self._known), "central was restarted and has forgotten it")
            self._snapshot_source, self._in_snapshot = (epoch, number), set()

    def _on_snapshot_end(self) -> None:
        self._start_snapshot()
        self._publish_ends(
            [task for task in self._known if task not in self._in_snapshot], _ENDED_UNSEEN
        )
        self._in_snapshot, self._has_snapshot = set(), True

    def _publish_ends(self, tasks: list[int], why: str) -> None:
        """Publish the ends of tasks that ended unseen."""
        for task in tasks:
            _, message, goal = self._known.pop(task)
            end = StateChange(
                TaskId(task),
                message,
                -1,
                "",
                "",
                Party.CENTRAL,
                text=why,
                goal=goal,
                is_late=True,
                is_over=True,
            )
            self._publish(end, 1)

    def _publish(self, change: StateChange, missed: int) -> None:
        observed = ObservedChange(
            change,
            with_epoch(
                change.task, self._snapshot_source[0], numbered(change.message, change.task)
            ),
            missed,
        )
        self._before_readers(observed)
        for reader in list(self._readers):
            reader.add(observed)

    def _before_readers(self, observed: ObservedChange) -> None:
        """Call the functions with a change, before its readers get it."""
        for function in list(self._functions):
            function(observed)
