"""A restarted central gives its first messages the numbers of old ones: what is left of those means the old ones."""

import asyncio
import queue
import threading
from contextlib import suppress

import pytest
from module.real_central import until

from tca_module import Client, Command, Module, Query, Task
from tca_module.sending.later_reply import LaterReply
from tca_module.testing import LocalCentral

pytestmark = pytest.mark.usefixtures("attentive")

SOON = 10.0

WORK = Command("work", str, result=str)
NOBODY, LAST = Query("nobody", reply=int), Query("last", reply=int)


def the_new_one_has_the_number_and_its_own_answer(
    central: LocalCentral, user: Client, begun: "queue.Queue[str]"
) -> None:
    """The same work once in the old central, and in the new one under the same number."""
    user.command(WORK, "old")
    old = begun.get(timeout=SOON)
    central.restart("afresh")
    user.wait_until_handled(WORK, timeout=SOON)
    new = user.command(WORK, "new")
    assert begun.get(timeout=SOON) == old.replace("old", "new")
    assert new.result(SOON) == "new"


def test_a_coroutine_that_cleans_up_does_not_answer_for_a_new_one(central: LocalCentral, user: Client) -> None:
    module, begun, go_on = Module("worker", central), queue.Queue[str](), threading.Event()

    @module.handles(WORK)
    async def work(task: Task, data: str) -> str:
        begun.put(f"{data} {task.id}")
        if data == "old":
            with suppress(asyncio.CancelledError):
                await task.query_send(NOBODY)
            await asyncio.to_thread(go_on.wait, SOON)
        else:
            go_on.set()
            for _ in range(50):  # while the old one returns
                await task.query_send(LAST)
        return data

    module.handles(LAST)(lambda _: 1)
    with module.running():
        the_new_one_has_the_number_and_its_own_answer(central, user, begun)


def test_an_answer_that_was_owed_to_the_old_central_is_not_given_to_the_new_one(
    central: LocalCentral, user: Client
) -> None:
    module, begun, owed = Module("worker", central), queue.Queue[str](), list[LaterReply[str]]()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str | LaterReply[str]:
        begun.put(f"{data} {task.id}")
        if data == "old":
            owed.append(task.reply_later())
            return owed[0]
        owed[0].reply("old")
        task.query_send(LAST).receive(SOON)  # in this wait it leaves
        return data

    module.handles(LAST, resource="last")(lambda _: 1)
    with module.running():
        the_new_one_has_the_number_and_its_own_answer(central, user, begun)


def test_who_owes_an_answer_to_the_old_central_reads_that_it_is_void(central: LocalCentral, user: Client) -> None:
    module, owed = Module("worker", central), queue.Queue[LaterReply[str]]()

    @module.handles(WORK)
    def work(task: Task, _: str) -> LaterReply[str]:
        owed.put(later := task.reply_later())
        return later

    with module.running():
        user.command(WORK, "old")
        old = owed.get(timeout=SOON)
        central.restart("afresh")
        user.wait_until_handled(WORK, timeout=SOON)
        task = user.command(WORK, "new")
        new = owed.get(timeout=SOON)
        assert (old.cancelled, new.cancelled) == (True, False)
        new.reply("new")
        assert task.result(SOON) == "new"


def test_a_handler_that_holds_while_its_task_is_suspended_holds_no_forgotten_one(
    central: LocalCentral, user: Client
) -> None:
    module, read, go_on = Module("worker", central), queue.Queue[bool](), threading.Event()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str:
        until(lambda: task.suspended, "its task is suspended")
        read.put(True)
        go_on.wait(SOON)
        until(lambda: not task.suspended, "it holds no longer")
        read.put(task.cancelled and not task.suspended)
        return data

    with module.running():
        user.command(WORK, "old").suspend()
        assert read.get(timeout=SOON)
        central.restart("afresh")
        go_on.set()
        assert read.get(timeout=SOON)
