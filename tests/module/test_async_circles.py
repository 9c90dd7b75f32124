"""Circles through ``await``: seen where a coroutine can't go on by itself, and never where it can."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import pytest
from module.real_central import until

from tca_module import Client, Command, Module, Outcome, Query, Task, TaskFailed
from tca_module.serving import coroutine_waits
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import RequestRefused

DRAW, MAP = Command("draw"), Command("map")
LOOK, WHERE = Query("look", reply=int), Query("where", reply=int)
HOLD, REST = Command("hold"), Command("rest")
SOON = 20.0


@pytest.fixture(autouse=True)
def _soon_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Central hears of a coroutine that waits after 0.2 s already, and not after 1 s."""
    monkeypatch.setattr(coroutine_waits, "BRIEF", 0.2)


How = Callable[[Awaitable[Any]], Coroutine[Any, Any, Any]]


async def alone(awaited: Awaitable[Any]) -> Any:
    return await awaited


async def gathered(awaited: Awaitable[Any]) -> Any:
    return (await asyncio.gather(awaited))[0]


async def in_a_group(awaited: Awaitable[Any]) -> Any:
    async with asyncio.TaskGroup() as group:
        task = group.create_task(alone(awaited))
    return task.result()


async def in_a_task(awaited: Awaitable[Any]) -> Any:
    return await asyncio.create_task(alone(awaited))


async def as_the_first(awaited: Awaitable[Any]) -> Any:
    done, _ = await asyncio.wait([asyncio.create_task(alone(awaited))], return_when=asyncio.FIRST_COMPLETED)
    return done.pop().result()


async def in_time(awaited: Awaitable[Any]) -> Any:
    async with asyncio.timeout(SOON):
        return await awaited


class Circle:
    """Two modules, each of whose one slot waits for what the other's must handle."""

    def __init__(self, central: Any, how: How) -> None:
        self.eyes, self.maps = Module("eyes", central), Module("maps", central)
        both = threading.Barrier(2)
        self.maps.handles(WHERE)(lambda _: 1)
        self.eyes.handles(LOOK)(lambda _: 1)

        @self.eyes.handles(DRAW)
        async def draw(task: Task) -> None:
            both.wait(SOON)
            await how(task.query_send(WHERE))

        @self.maps.handles(MAP)
        async def map_(task: Task) -> None:
            both.wait(SOON)
            await how(task.query_send(LOOK))

    def outcomes(self, user: Client) -> tuple[str, list[Outcome]]:
        """What became of both; the failure of the one that failed."""
        with self.eyes.running(), self.maps.running():
            refs = user.command(DRAW, sequential=False), user.command(MAP, sequential=False)
            outcomes = sorted(ref.wait(SOON) for ref in refs)
            failed = next(ref for ref in refs if ref.wait() is Outcome.FAILED)
            with pytest.raises(TaskFailed) as raised:
                failed.result()
        return f"{raised.value.failure}: {raised.value}", outcomes


@pytest.mark.parametrize("how", [alone, gathered, in_a_group, in_a_task, as_the_first, in_time])
def test_one_await_of_a_circle_is_refused_and_the_other_goes_on(how: How, central: LocalCentral, user: Client) -> None:
    text, outcomes = Circle(central, how).outcomes(user)
    assert outcomes == [Outcome.DONE, Outcome.FAILED]
    assert text.startswith("deadlock: ")
    assert "draw {" in text
    assert "map {" in text


class Device:
    """Lets go of what coroutines wait for, from a thread of its own."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.event = asyncio.Event()

    async def wait(self) -> None:
        self.loop = asyncio.get_running_loop()
        await self.event.wait()

    def ready(self) -> None:
        assert self.loop is not None
        self.loop.call_soon_threadsafe(self.event.set)


async def beside_a_device(awaited: Awaitable[Any], device: Device) -> None:
    """It waits for the map, while an asyncio task beside holds the legs until the device is ready."""
    beside = asyncio.create_task(device.wait())
    await awaited
    await beside


async def for_the_first_of_both(awaited: Awaitable[Any], device: Device) -> None:
    tasks = [asyncio.create_task(alone(awaited)), asyncio.create_task(device.wait())]
    _, waiting = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in waiting:
        task.cancel()


async def for_the_device(awaited: Awaitable[Any], device: Device) -> None:
    beside = asyncio.create_task(alone(awaited))
    await device.wait()
    beside.cancel()


async def with_a_shield(awaited: Awaitable[Any], device: Device) -> None:
    beside = asyncio.ensure_future(alone(awaited))
    waiting = asyncio.create_task(device.wait())
    await asyncio.wait([asyncio.shield(beside), asyncio.shield(waiting)], return_when=asyncio.FIRST_COMPLETED)
    beside.cancel()


def told(central: LocalCentral) -> set[str]:
    """The messages of the coroutines that central takes to wait."""
    core = central.core
    waits = [wait for connection in list(core.blocked) for wait in list(connection.waits.values()) if wait.together]
    handled = [core.dispatcher.running.get(wait.origin) for wait in waits]
    return {delivery.message.name for delivery in handled if delivery is not None}


@pytest.mark.parametrize("how", [beside_a_device, for_the_first_of_both, for_the_device, with_a_shield])
def test_a_handler_that_something_else_may_bring_on_is_not_refused(
    how: Callable[[Awaitable[Any], Device], Coroutine[Any, Any, None]], central: LocalCentral, user: Client
) -> None:
    """Of what is awaited besides central's answers nothing is known. Somebody else, who can be seen to wait, is waited
    for twice, so that there was time enough to be wrong.
    """
    eyes, maps, control = Module("eyes", central), Module("maps", central), Module("control", central)
    made: list[Device] = []
    go_on = threading.Event()

    @eyes.handles(DRAW)
    async def draw(task: Task) -> None:
        made.append(Device())
        await how(task.query_send(WHERE), made[0])

    @maps.handles(WHERE)
    def where(task: Task) -> int:
        if how is beside_a_device:
            return 1 if go_on.wait(SOON) else 0
        return task.query(LOOK, timeout=SOON)

    @control.handles(MAP)
    async def map_(task: Task) -> None:
        await task.command(REST)

    @maps.handles(REST)
    def rest(_: Task) -> None: ...

    eyes.handles(LOOK)(lambda _: 1)
    with eyes.running(), maps.running(), control.running():
        drawing = user.command(DRAW, sequential=False)
        until(lambda: made and made[0].loop, "it waits for its device")
        for _ in range(2):
            seen = user.command(MAP, sequential=False)
            until(lambda: "map" in told(central), "the one that is seen")
            assert "draw" not in told(central)
            seen.kill("it was seen")
            until(lambda: "map" not in told(central), "the one that was seen has gone")
        go_on.set()
        made[0].ready()
        assert drawing.wait(SOON) is Outcome.DONE
    assert not [fact for fact in central.facts if isinstance(fact, RequestRefused)]


def test_what_is_awaited_only_so_long_is_given_up(central: LocalCentral, user: Client) -> None:
    """And who waited so is no longer taken to wait."""
    eyes, maps, go_on = Module("eyes", central), Module("maps", central), threading.Event()
    ended: list[bool] = []

    @eyes.handles(DRAW)
    async def draw(task: Task) -> None:
        loop, deadline = asyncio.get_running_loop(), asyncio.timeout(None)

        def end_it() -> None:
            until(lambda: "draw" in told(central), "it is seen to wait")
            loop.call_soon_threadsafe(deadline.reschedule, 0)

        seen = threading.Thread(target=end_it)
        seen.start()
        try:
            async with deadline:
                await task.query_send(WHERE)
        except TimeoutError:
            ended.append("draw" not in told(central))

    @maps.handles(WHERE)
    def where(_: Task) -> int:
        return 1 if go_on.wait(SOON) else 0

    with eyes.running(), maps.running():
        assert user.command(DRAW).wait(SOON) is Outcome.DONE
        go_on.set()
    assert ended == [True]
