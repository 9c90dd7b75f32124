"""What central tells of tasks' states: in order, each change once, and how many were missed.

Central first tells how things stand, then that this is all, then each change. After its restart,
and after a break that it has noticed, it does so again: tasks of which it does not tell then have
ended meanwhile.
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
"""Changes that wait to be read; the oldest beyond that count as missed."""

_ENDED_UNSEEN = "it ended while this program did not hear central"

_decode = msgspec.msgpack.Decoder(StateChange).decode


class News(NamedTuple):
    """A change of a task's state, as it came."""

    change: StateChange
    task: TaskId
    missed: int
    """The number of changes before it that nobody here has seen."""


def is_progress(news: News) -> bool:
    """Whether its data are an intermediate result."""
    change = news.change
    return bool(change.data) and not change.is_over and change.by is not Party.CLIENT


Wants = Callable[[News], bool]


class Unread:
    """The news that one reader wants and has not read; none from before it was made."""

    def __init__(self, wants: Wants) -> None:
        self._wants = wants
        self._unread: deque[News] = deque()
        self._dropped: dict[int, int] = {}  #: by task: changes for which there was no room

    def __bool__(self) -> bool:
        return bool(self._unread)

    def put(self, news: News) -> None:
        """Something has changed."""
        if not self._wants(news):
            return
        self._unread.append(news)
        if len(self._unread) > MOST_UNREAD:
            oldest = self._unread.popleft()
            self._dropped[oldest.task] = self._dropped.get(oldest.task, 0) + oldest.missed + 1

    def begin_with(self, news: News) -> None:
        """The first one, which came before this was made."""
        self._unread.append(news)

    def clear(self) -> None:
        """Nobody wants to read them."""
        self._unread.clear()

    def take(self) -> News:
        """The oldest of them."""
        news = self._unread.popleft()
        return news._replace(missed=news.missed + self._dropped.pop(news.task, 0))


class _Last(NamedTuple):
    """The newest change of a task, as much of it as may be needed."""

    serial: int
    message: str
    goal: bytes


class Observation:
    """A request for news of some tasks' states, for as long as somebody has this."""

    def __init__(self, connection: Connection, header: Observe, what: object) -> None:
        self.connection = connection
        self._functions: list[Callable[[News], object]] = []  # get each before its readers do
        self._what = what  # for errors
        self._header = header
        self._readers: weakref.WeakSet[Unread] = weakref.WeakSet()
        self._is_held = False
        self._known: dict[int, _Last] = {}  # of living tasks, unless only some states are wanted
        self._present: set[int] = set()  # tasks of which it has been told how they stand
        self._round = ("", 0)  # the central, and the request, that tell of these
        self._is_complete = False  # they have told of all
        self._is_given_up = False
        self.request = self._ask()  #: as it stands

    def _ask(self) -> Request:
        request = self.connection.request(self._header, wants_answer=True)
        abandon, me = self.connection.abandon, weakref.ref(self)

        def tell() -> None:
            if (observation := me()) is not None:
                observation._take_in()  # noqa: SLF001
            elif not request.is_over:
                abandon(request)

        request.notify = self._take_in if self._is_held else tell
        return request

    def call(self, function: Callable[[News], object]) -> None:
        """Call a function with all news from now on, until the end or ``close()``, also if nobody
        has this.
        """
        self._functions.append(function)
        self._is_held = True
        self.request.notify = self._take_in

    # --- reading ----------------------------------------------------------------------------------

    @property
    def is_complete(self) -> bool:
        """Whether it is known how things stand."""
        return self._is_complete or self.is_over

    @property
    def is_over(self) -> bool:
        """Whether nothing more will come."""
        return self.request.is_over and not self.request.answers

    def unread(self, wants: Wants = lambda _: True) -> Unread:
        """A place for news from now on."""
        unread = Unread(wants)
        self._readers.add(unread)
        return unread

    def forget(self, reader: Unread) -> None:
        """Somebody reads no more."""
        self._readers.discard(reader)
        reader.clear()

    def wait(self, is_there: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *is_there*, or nothing more can come; whether it is. Raises what
        ``Connection.wait`` does.
        """
        self.catch_up()
        if not is_there():
            try:
                self.connection.wait(
                    self.request, timeout, self._what, lambda: self._settles(is_there)
                )
            except BaseException as error:
                self._on_error(error)
                raise
        self._call()
        return is_there()

    def until(self, is_there: Callable[[], bool]) -> Generator[Any, None, bool]:
        """The same for coroutines, which await it; ``asyncio.timeout`` limits the wait."""
        self.catch_up()
        if not is_there():
            try:
                yield from self.connection.until_over(
                    self.request, self._what, lambda: self._settles(is_there)
                )
            except Deadlock as error:
                self._on_error(error)
                raise
            except CentralLost:
                self._have_been_told()
                raise
        self._call()
        return is_there()

    def hear_end(self) -> None:
        """All that it is about has ended, and central tells that at the same time: functions are
        called with it before the caller goes on.
        """
        if self._is_held:
            self.connection.hear_out(self.request)

    def _call(self) -> None:
        """Functions are called with what has come before the caller goes on, who knows it, too."""
        if self._is_held:
            self.connection.attend()

    def _on_error(self, error: BaseException) -> None:
        """A wait has ended with an error: it has given the request up, or central has, because it
        could never end. So it begins anew: now, if functions are called, else when somebody looks.
        """
        self._is_given_up = not self.request.is_over or isinstance(error, Deadlock)
        if self._is_given_up and self._is_held:
            with suppress(CentralLost):
                self._is_given_up, self.request = False, self._ask()
        if isinstance(error, CentralLost):
            self._have_been_told()

    def _have_been_told(self) -> None:
        """The user hears that the task was lost with central: the end of the program need not say
        it.
        """
        if isinstance(self._header.task, SentId):
            self.connection.session.sends.discard(self._header.task.request)

    def _settles(self, is_there: Callable[[], bool]) -> bool:
        self._take_in()
        return is_there() or self.is_over

    def catch_up(self) -> None:
        """Take in what has arrived; begin anew if a wait has given the request up. Never waits."""
        if self._is_given_up:
            self._is_given_up, self.request = False, self._ask()
        self.connection.catch_up()
        self._take_in()

    def nudge(self) -> None:
        """Let a coroutine that waits look again."""
        if self.request.wakes is not None:
            self.request.wakes()

    def check(self) -> None:
        """Raise the error that the request came to, if any."""
        self.request.check(self._what)

    def close(self) -> None:
        """Want no more news."""
        if not self.request.is_over:
            self.connection.abandon(self.request)
        self.request.is_over, self._is_given_up = True, False
        self.request.notify = None
        self.request.answers.clear()

    # --- what comes -------------------------------------------------------------------------------

    def _take_in(self) -> None:
        while self.request.answers:
            answer, body = self.request.answers.popleft()
            if body:
                self._on_change(_decode(body))
            elif answer.more:
                self._on_all_told()
        refused = self.request.refused
        is_refused_wait = (
            refused is not None and refused.refusal is Refusal.DEADLOCK
        )  # who waits hears it
        if self._is_held and self.request.has_failed and not is_refused_wait:
            self._is_held = False
            try:
                self.check()
            except (CentralLost, Refused) as error:  # nobody waits, who could be told
                self.connection.log.error("%s; functions are not called with it any more", error)  # noqa: TRY400

    def _on_change(self, change: StateChange) -> None:
        if change.is_late:
            self._begin_round()
            self._present.add(change.task)
        known = self._known.get(change.task)
        if known is not None and 0 <= change.serial <= known.serial:
            return  # it has been seen, or is older than what has
        if change.is_over:
            self._known.pop(change.task, None)
        elif not self._header.states:
            self._known[change.task] = _Last(change.serial, change.message, change.goal)
        self._publish(change, max(0, change.serial - known.serial - 1) if known is not None else 0)

    def _begin_round(self) -> None:
        """Central tells how things stand, if it does not already."""
        epoch, number = self.connection.session.epoch, self.request.header.number
        if (epoch, number) != self._round:
            if epoch != self._round[0]:
                self._forget(list(self._known), "central was restarted and has forgotten it")
            self._round, self._present = (epoch, number), set()

    def _on_all_told(self) -> None:
        self._begin_round()
        self._forget([task for task in self._known if task not in self._present], _ENDED_UNSEEN)
        self._present, self._is_complete = set(), True

    def _forget(self, tasks: list[int], why: str) -> None:
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
        news = News(
            change,
            with_epoch(change.task, self._round[0], numbered(change.message, change.task)),
            missed,
        )
        self._hear(news)
        for reader in list(self._readers):
            reader.put(news)

    def _hear(self, news: News) -> None:
        """News, before its readers get it."""
        for function in list(self._functions):
            function(news)
