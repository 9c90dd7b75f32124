"""Every way to wait: central shows the wait, the tools list it, the check accepts it, and deadlocks
through it are found.

``WAYS`` has one row for each way, and a new way to wait needs a row. Left out are ``sleep``,
``wait_until`` without ``on``, and waits for a client's request. These three count as a handler's
own work (decision 103).
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from typing import Any

import pytest
from module.real_central import SOON, until
from tools.runs import OPENED, checked

from tca_behaviours.missions import Environment, Mission, OnceTask, Status, TaskEnd, TaskServer
from tca_module import (
    Client,
    Command,
    Inform,
    Module,
    MultiQuery,
    Query,
    SentTask,
    Task,
    wait_for_any,
)
from tca_module.serving import coroutine_waits
from tca_module.testing import LocalCentral
from tca_tools.explain.wait_words import named_waits
from tca_tools.explain.waits import waits_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_wire.journal.facts import RequestRefused
from tca_wire.vocabulary import Refusal
from tca_wire.waits import WaitKind

WAIT, OTHER = Command("wait"), Command("other", int, result=TaskEnd, progress=str)
BACK, ASKED, ALL = Query("back", reply=int), Query("asked", reply=int), MultiQuery("all", reply=int)
MISSING = Inform("missing")


async def _all(changes: Any) -> None:
    async for _ in changes:
        pass


async def _ended(waited: Any) -> None:
    await waited


def _mission(on: "Stage") -> None:
    with Mission("slow", under=on.task, central=on.central) as mission:
        mission.finish(mission.start_command(OTHER, 2, "other"))


class Nothing(OnceTask[Environment]):
    """The one task that a server must offer."""

    def iterate(self) -> None:
        pass


@dataclass(frozen=True)
class Way:
    """A way to wait for the task *other*, for the module that handles it, or for something else."""

    name: str
    wait: Callable[["Stage"], Any]
    kind: WaitKind
    target: str = "other"
    closes: bool = True  # the wait may close a cycle
    is_async: bool = False


WAYS = [
    Way("wait", lambda on: on.other.wait(), WaitKind.TASK),
    Way("wait with a timeout", lambda on: on.other.wait(timeout=SOON), WaitKind.TASK),
    Way("wait for a point", lambda on: on.other.wait_for(on.other.handling.end), WaitKind.TASK),
    Way("result", lambda on: on.other.result(), WaitKind.TASK),
    Way("wait for any", lambda on: wait_for_any([on.other]), WaitKind.TASK),
    Way("await a task", lambda on: _ended(on.other), WaitKind.TASK, is_async=True),
    Way("next change", lambda on: on.other.next_change(), WaitKind.CHANGE),
    Way("changes", lambda on: list(on.other.changes()), WaitKind.CHANGE),
    Way("progress", lambda on: next(on.other.progress(), None), WaitKind.CHANGE),
    Way("wait for a state", lambda on: on.other.wait_for_state("done"), WaitKind.CHANGE),
    Way("update", lambda on: on.other.update(2), WaitKind.CHANGE),
    Way("observe a task's own", lambda on: list(on.task.observe(below=on.task.ref)), WaitKind.CHANGE, "any task under"),
    Way("observe a message", lambda on: list(on.task.observe(OTHER)), WaitKind.CHANGE, "any other", closes=False),
    Way("await changes", lambda on: _all(on.other.changes()), WaitKind.CHANGE, is_async=True),
    Way("await progress", lambda on: _all(on.other.progress()), WaitKind.CHANGE, is_async=True),
    Way("await an update", lambda on: _ended(on.other.update_send(2)), WaitKind.CHANGE, is_async=True),
    Way("wait until, on a task", lambda on: on.task.wait_until(lambda: False, on=[on.other]), WaitKind.CHANGE,
        closes=False),
    Way("query", lambda on: on.task.query(ASKED), WaitKind.REPLY, "asked"),
    Way("fetch a reply", lambda on: on.task.query_send(ASKED).receive(), WaitKind.REPLY, "asked", closes=False),
    Way("notify", lambda on: on.task.query_notify(ASKED, None, lambda *_: None).wait(), WaitKind.REPLY, "asked", closes=False),
    Way("ask all", lambda on: on.task.multi_query(ALL), WaitKind.REPLY, "all", closes=False),
    Way("await a query", lambda on: _ended(on.task.query_send(ASKED)), WaitKind.REPLY, "asked", is_async=True),
    Way("lock", lambda on: on.task.lock("other", "other"), WaitKind.LOCK, "lock"),
    Way("reserve", lambda on: on.task.reserve("other", "other"), WaitKind.LOCK, "reservation"),
    Way("wait until handled", lambda on: on.task.wait_until_handled(MISSING), WaitKind.PRESENCE, "missing",
        closes=False),
    Way("mission", _mission, WaitKind.TASK, "other"),
]  # fmt: skip


class Stage:
    """A handler that waits in one way for another handler. The other handler waits for the test, or
    for a reply of the first module.
    """

    task: Task
    other: SentTask[TaskEnd]

    def __init__(self, way: Way, central: LocalCentral, *, in_cycle: bool) -> None:
        self.way, self.central, self.in_cycle = way, central, in_cycle
        self.go_on = threading.Event()
        self.waiter, self.server = Module("waiter", central), Module("other", central)
        self.offering = TaskServer("slow", Environment(), [Nothing], central=central)
        self.waiter.handles(BACK, resource="waiter")(lambda _: 1)
        wait = self._await if way.is_async else self._wait
        self.waiter.handles(WAIT, resource="waiter")(wait)
        for message in (ASKED, ALL):
            self.server.handles(message, resource="other")(self._stand)
        self.server.handles(OTHER, resource="other", takes=["update"])(self.serve_other)

    @contextmanager
    def waits(self, user: Client) -> Iterator[SentTask[None]]:
        """Run a block while the handler waits."""
        with self.offering.running(), self.server.running(), self.waiter.running():
            waiting = user.command(WAIT)
            try:
                yield waiting
            finally:
                self.go_on.set()
                waiting.kill("the test ends")
                waiting.wait(SOON)

    def serve_other(self, task: Task, _: int) -> TaskEnd:
        self._stand(task)
        return TaskEnd(Status.COMPLETED)

    def _stand(self, task: Task) -> int:
        if self.in_cycle:
            return task.query(BACK)
        assert self.go_on.wait(SOON)
        return 1

    def _begin(self, task: Task) -> None:
        with task.parallel():
            self.task, self.other = task, task.command(OTHER, 1)
        self.other.wait_for_state("running")

    def _wait(self, task: Task) -> None:
        self._begin(task)
        self.way.wait(self)

    async def _await(self, task: Task) -> None:
        self._begin(task)
        await self.way.wait(self)


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let coroutines report their waits soon."""
    monkeypatch.setattr(coroutine_waits, "BRIEF", 0.02)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_wait_is_shown_with_its_target(way: Way, central: LocalCentral, user: Client) -> None:
    def is_shown() -> bool:
        found = [one for one in user.status("load")["waits"] if one["number"] == waiting.id]
        return any(is_it(wait["kind"], wait["name"]) for one in found for wait in one["waits"])

    def is_it(kind: str, name: str) -> bool:
        return kind == way.kind and name.startswith(way.target)

    with Stage(way, central, in_cycle=False).waits(user) as waiting:
        until(is_shown, f"{way.name} is shown")
        run = History.until(central.entries[:])
        waits = [one for one in waits_of(run, waiting.id) if one.end == inf]
        assert [is_it(one.kind, named_waits(RunAt(run), [one])[0].name) for one in waits].count(
            True
        ) == 1
    left = [
        wait for handling in History.until(central.entries).handlings for wait in handling.waits
    ]
    assert not [wait for wait in left if wait.end is None]
    assert not checked([OPENED, *central.entries])


@pytest.mark.parametrize("way", [way for way in WAYS if way.closes], ids=lambda way: way.name)
def test_deadlock_through_wait_is_found(way: Way, central: LocalCentral, user: Client) -> None:
    def is_found() -> bool:
        refused = [fact for fact in central.facts if isinstance(fact, RequestRefused)]
        return Refusal.DEADLOCK in [fact.refusal for fact in refused]

    with Stage(way, central, in_cycle=True).waits(user):
        until(is_found, way.name)
