"""A restarted central gives its first messages the numbers of old ones: what is left of those means the old ones."""

import asyncio
import queue
import threading
from contextlib import suppress

from tca_module import Client, Command, Module, Query, Task
from tca_module.later import Later
from tca_module.testing import LocalCentral

SOON = 10.0

WORK = Command("work", str, result=str)
NOBODY, LAST = Query("nobody", reply=int), Query("last", reply=int)


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
        user.command(WORK, "old")
        old = begun.get(timeout=SOON)
        central.restart("afresh")
        user.wait_until_handled(WORK, timeout=SOON)
        new = user.command(WORK, "new")
        assert begun.get(timeout=SOON) == old.replace("old", "new")
        assert new.result(SOON) == "new"


def test_an_answer_that_was_owed_to_the_old_central_is_not_given_to_the_new_one(
    central: LocalCentral, user: Client
) -> None:
    module, begun, owed = Module("worker", central), queue.Queue[str](), list[Later[str]]()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str | Later[str]:
        begun.put(f"{data} {task.id}")
        if data == "old":
            owed.append(task.reply_later())
            return owed[0]
        owed[0].reply("old")
        task.query_send(LAST).receive(SOON)  # in this wait it leaves
        return data

    module.handles(LAST, resource="last")(lambda _: 1)
    with module.running():
        user.command(WORK, "old")
        old = begun.get(timeout=SOON)
        central.restart("afresh")
        user.wait_until_handled(WORK, timeout=SOON)
        new = user.command(WORK, "new")
        assert begun.get(timeout=SOON) == old.replace("old", "new")
        assert new.result(SOON) == "new"


def test_who_owes_an_answer_to_the_old_central_reads_that_it_is_void(central: LocalCentral, user: Client) -> None:
    module, owed = Module("worker", central), queue.Queue[Later[str]]()

    @module.handles(WORK)
    def work(task: Task, _: str) -> Later[str]:
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
