"""The changes of tasks' states, as central reports them: in order, each once, with missed counts.

Central first sends a snapshot: the present state of each living task. Then it sends each change.
After a restart of central, and after a broken connection, central sends a snapshot again. Tasks
that are missing in the new snapshot have ended in the meantime.
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
from tca_wire.packets.large import is_large
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Party, Refusal

MOST_UNREAD = 10_000
"""The most changes that wait to be read. If there are more, the oldest count as missed."""

_ENDED_UNSEEN = "it ended while this program did not hear central"

_decode = msgspec.msgpack.Decoder(StateChange).decode


class ObservedChange(NamedTuple):
    """A change of a task's state, as this program received it."""

    change: StateChange
    task: TaskId
    missed: int
    """The number of changes directly before this change that this program did not receive."""


def is_progress(observed: ObservedChange) -> bool:
    """Whether the data of a change are an intermediate result."""
    change = observed.change
    return bool(change.data) and not change.is_over and change.by is not Party.CLIENT


Wants = Callable[[ObservedChange], bool]


class UnreadChanges:
    """The wanted changes that have arrived since the reader was made and are not read yet."""

    def __init__(self, wants: Wants) -> None:
        self._wants = wants
        self._unread: deque[ObservedChange] = deque()
        self._dropped: dict[int, int] = {}  #: by task: the number of dropped changes

    def __bool__(self) -> bool:
        return bool(self._unread)

    def add(self, observed: ObservedChange) -> None:
        """Add a change if the reader wants it. Drops the oldest change if there are too many."""
        if not self._wants(observed):
            return
        self._unread.append(observed)
        if len(self._unread) > MOST_UNREAD:
            oldest = self._unread.popleft()
            self._dropped[oldest.task] = self._dropped.get(oldest.task, 0) + oldest.missed + 1

    def start_with(self, observed: ObservedChange) -> None:
        """Add a change that arrived before the reader was made, as the reader's first change."""
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

    The observation ends when it is garbage collected, unless functions are called with the changes.
    """

    def __init__(self, connection: Connection, header: Observe, what: object) -> None:
        self.connection = connection
        # Functions that are called with a change before the readers get it.
        self._functions: list[Callable[[ObservedChange], object]] = []
        self._what = what  # for errors
        self._header = header
        self._readers: weakref.WeakSet[UnreadChanges] = weakref.WeakSet()
        self._calls_functions = False
        # The newest changes of living tasks; empty if only some states are observed.
        self._last_changes: dict[int, _LastChange] = {}
        self._in_snapshot: set[int] = set()  # the tasks in the present snapshot
        self._snapshot_source = ("", 0)  # the epoch, and the request, of the present snapshot
        self._has_snapshot = False  # a snapshot has arrived whole
        self._is_given_up = False
        self.request = self._send_request()  #: the present request; it may be sent again

    def _send_request(self) -> Request:
        request = self.connection.request(self._header, wants_answer=True)
        abandon, reference = self.connection.abandon, weakref.ref(self)

        # The function holds only a weak reference, so that an unused observation is garbage
        # collected.
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

    def add_reader(self, wants: Wants = lambda _: True) -> UnreadChanges:
        """Return a new reader, which collects the wanted changes from now on."""
        reader = UnreadChanges(wants)
        self._readers.add(reader)
        return reader

    def remove_reader(self, reader: UnreadChanges) -> None:
        """Collect no more changes for a reader."""
        self._readers.discard(reader)
        reader.clear()

    def wait(self, has_arrived: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *has_arrived* returns true, or no more changes can come.

        Returns the last value of *has_arrived*. Raises what ``Connection.wait`` does.
        """
        self.catch_up()
        if not has_arrived():
            try:
                self.connection.wait(
                    self.request, timeout, self._what, lambda: self._is_settled(has_arrived)
                )
            except BaseException as error:
                self._on_error(error)
                raise
        self._call_functions()
        return has_arrived()

    def wait_in_coroutine(self, has_arrived: Callable[[], bool]) -> Generator[Any, None, bool]:
        """Wait as ``wait`` does, in the coroutine that awaits this."""
        self.catch_up()
        if not has_arrived():
            try:
                yield from self.connection.wait_in_coroutine(
                    self.request, self._what, lambda: self._is_settled(has_arrived)
                )
            except Deadlock as error:
                self._on_error(error)
                raise
            except CentralLost:
                self._discard_lost_send()
                raise
        self._call_functions()
        return has_arrived()

    def receive_end(self) -> None:
        """Wait for the report of the observed task's end, and call the functions with it.

        Central has sent that report already.
        """
        if self._calls_functions:
            self.connection.wait_for_end(self.request)

    def _call_functions(self) -> None:
        """Call the functions with all changes that have arrived, before the wait returns."""
        if self._calls_functions:
            self.connection.process_pending()

    def _on_error(self, error: BaseException) -> None:
        """Send the request again after a wait that ended with an error.

        The wait has given up the request, or central has ended it because of a deadlock. The new
        request is sent at once if functions are called, otherwise at the next use.
        """
        self._is_given_up = not self.request.is_over or isinstance(error, Deadlock)
        if self._is_given_up and self._calls_functions:
            with suppress(CentralLost):
                self._is_given_up, self.request = False, self._send_request()
        if isinstance(error, CentralLost):
            self._discard_lost_send()

    def _discard_lost_send(self) -> None:
        """Forget the error of the task's send, because the caller raises an error anyway."""
        if isinstance(self._header.task, SentId):
            self.connection.session.sends.discard(self._header.task.request)

    def _is_settled(self, has_arrived: Callable[[], bool]) -> bool:
        self._process_answers()
        return has_arrived() or self.is_over

    def catch_up(self) -> None:
        """Process arrived packets. Sends the request again if it was given up. Never waits."""
        if self._is_given_up:
            self._is_given_up, self.request = False, self._send_request()
        self.connection.catch_up()
        self._process_answers()

    def wake_waiter(self) -> None:
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
                self._on_change(self._opened(_decode(body)))
            elif answer.more:
                self._on_snapshot_end()
        refused = self.request.refused
        # If central refused a wait because of a deadlock, only the waiting caller has an error.
        is_refused_wait = refused is not None and refused.refusal is Refusal.DEADLOCK
        if self._calls_functions and self.request.has_failed and not is_refused_wait:
            self._calls_functions = False
            try:
                self.check()
            except (CentralLost, Refused) as error:  # logged: no caller could catch it
                text = f"{error}; no function is called with these changes any more"
                self.connection.log.error("%s", text)  # noqa: TRY400

    def _opened(self, change: StateChange) -> StateChange:
        """Return a change with the memory of its large data."""
        if not (is_large(change.goal) or is_large(change.data)):
            return change
        opened = self.connection.opened
        change = msgspec.structs.replace(change, goal=opened(change.goal), data=opened(change.data))
        self.connection.line.acknowledge([])
        return change

    def _on_change(self, change: StateChange) -> None:
        if change.is_late:
            self._start_snapshot()
            self._in_snapshot.add(change.task)
        last = self._last_changes.get(change.task)
        if last is not None and 0 <= change.serial <= last.serial:
            return  # received before, or older than the newest change
        if change.is_over:
            self._last_changes.pop(change.task, None)
        elif not self._header.states:
            self._last_changes[change.task] = _LastChange(
                change.serial, change.message, change.goal
            )
        self._publish(change, max(0, change.serial - last.serial - 1) if last is not None else 0)

    def _start_snapshot(self) -> None:
        """Start a snapshot, unless the snapshot of this epoch and request has started already."""
        epoch, number = self.connection.session.epoch, self.request.header.number
        if (epoch, number) != self._snapshot_source:
            if epoch != self._snapshot_source[0]:
                self._publish_ends(
                    list(self._last_changes), "central was restarted and has forgotten it"
                )
            self._snapshot_source, self._in_snapshot = (epoch, number), set()

    def _on_snapshot_end(self) -> None:
        self._start_snapshot()
        self._publish_ends(
            [task for task in self._last_changes if task not in self._in_snapshot], _ENDED_UNSEEN
        )
        self._in_snapshot, self._has_snapshot = set(), True

    def _publish_ends(self, tasks: list[int], why: str) -> None:
        """Publish the ends of tasks that ended unseen."""
        for task in tasks:
            _, message, goal = self._last_changes.pop(task)
            end = StateChange(TaskId(task), message, -1, "", "", Party.CENTRAL, text=why, goal=goal)
            self._publish(msgspec.structs.replace(end, is_late=True, is_over=True), 1)

    def _publish(self, change: StateChange, missed: int) -> None:
        what, (epoch, _) = numbered(change.message, change.task), self._snapshot_source
        observed = ObservedChange(change, with_epoch(change.task, epoch, what), missed)
        self._process_change(observed)
        for reader in list(self._readers):
            reader.add(observed)

    def _process_change(self, observed: ObservedChange) -> None:
        """Call the functions with a change, before its readers get it."""
        for function in list(self._functions):
            function(observed)
