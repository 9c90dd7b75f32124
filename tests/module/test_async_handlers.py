"""``async def`` handlers: awaits, background tasks, ends, and deadlocks through ``await``."""

import asyncio
import queue
import sys
import threading
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import pytest
from module.real_central import SOON, until
from module.robot import COLLISION, MOVE_LEG, REST, STANCE, STOP, TEMPERATURE, WALK, Arc, Footfall

from tca_module import (
    Client,
    Command,
    MisuseError,
    Module,
    Outcome,
    Query,
    QueryFailed,
    Task,
    TaskFailed,
    TaskKilled,
    connect,
)
from tca_module.serving import coroutine_waits
from tca_module.testing import LocalCentral
from tca_wire.journal.causes import Request
from tca_wire.journal.facts import Delivered, Failed, Received, RequestRefused, Returned
from tca_wire.packets.codec import unpack_to_central
from tca_wire.packets.headers import Await


def test_async_handler_awaits_tasks_of_its_own_resource(central: LocalCentral) -> None:
    """The slot is lent at once. Before central sees that a handler stands, a second passes."""
    legs, lift, climb = Module("legs", central), Command("lift", int), Command("climb", int)
    legs.handles(lift)(lambda *_: None)

    @legs.handles(climb)
    async def climbs(task: Task, steps: int) -> None:
        for step in range(steps):
            await task.command(lift, step)

    with legs.running(), connect("user", central) as user:
        user.command(climb, 3).result(SOON)
    delivered = [fact.is_nested for fact in central.facts if isinstance(fact, Delivered)]
    assert delivered == [False, True, True, True]
    causes = [entry.cause for entry in central.entries if isinstance(entry.cause, Request)]
    assert "AwaitAny" not in [cause.message for cause in causes]


def test_slot_event_loop_runs_background_tasks_between_handlers(legs: Module, user: Client) -> None:
    loops, went_on = [], threading.Event()

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        async def afterwards() -> None:
            await asyncio.sleep(0.01)
            went_on.set()

        loops.append(asyncio.get_running_loop())
        background.add(asyncio.create_task(afterwards()))

    background: set[asyncio.Task[None]] = set()
    with legs.running():
        user.goal(REST).result(SOON)
        assert went_on.wait(SOON)
        user.goal(REST).result(SOON)
    assert loops[0] is loops[1]
    assert loops[0].is_closed()


def test_plain_and_async_handlers_share_one_slot(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        awaited, waited_for = (
            await task.query_send(TEMPERATURE),
            task.query(TEMPERATURE, timeout=SOON),
        )
        return [int(awaited), int(waited_for)]

    class Legs:
        async def __call__(self, task: Task, leg: int) -> Footfall:
            stance = await asyncio.to_thread(lambda: [36])
            return Footfall(stance[0], 0.0)

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    legs.handles(MOVE_LEG)(Legs())

    with legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [36, 36]
        assert user.command(MOVE_LEG, 1).result(SOON) == Footfall(36, 0.0)


def test_awaited_task_yields_its_result_or_failure(
    legs: Module, eyes: Module, user: Client, central: LocalCentral
) -> None:
    eyes.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))

    @legs.handles(WALK)
    async def walk(task: Task, arc: Arc) -> None:
        ref = task.command(MOVE_LEG, 4)
        assert await ref == Footfall(4, 0.5)
        assert await ref == ref.result()
        one, other = await asyncio.gather(task.command(MOVE_LEG, 1), task.command(MOVE_LEG, 2))
        assert (one.leg, other.leg) == (1, 2)
        never = task.command(STOP)
        never.kill("not needed")
        with pytest.raises(TaskKilled, match="not needed"):
            await never

    with legs.running(), eyes.running():
        user.goal(WALK, Arc(1.0, 1)).result(SOON)
    moves = [
        fact for fact in central.facts if isinstance(fact, Received) and fact.message == "move leg"
    ]
    assert [fact.parent for fact in moves] == [1, 1, 1]


def test_coroutine_queries_its_own_slot(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        return [int(radius), *await task.query_send(STANCE, radius - 1)] if radius > 1 else [1]

    with legs.running():
        assert user.query(STANCE, 4.0, timeout=SOON) == [4, 3, 2, 1]


def test_blocking_query_of_own_slot_fails_in_coroutine(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        return task.query(STANCE, radius - 1, timeout=SOON) if radius > 1 else [1]

    with (
        legs.running(),
        pytest.raises(QueryFailed, match=r"blocks its event loop: await that call with"),
    ):
        user.query(STANCE, 2.0, timeout=SOON)


def test_awaited_query_is_given_up_after_asyncio_timeout(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        pending = task.query_send(TEMPERATURE)
        try:
            async with asyncio.timeout(0.01):
                await pending
        except TimeoutError:
            with pytest.raises(MisuseError, match="query 'temperature' was given up"):
                pending.receive()
            return [1]
        return [2]

    with legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]
        assert user.status("messages")
    assert "no module handles it" in {getattr(fact, "where", "") for fact in central.facts}


@pytest.mark.parametrize("ends_well", [False, True])
def test_killed_task_is_cancelled_at_its_await(
    legs: Module,
    user: Client,
    central: LocalCentral,
    caplog: pytest.LogCaptureFixture,
    *,
    ends_well: bool,
) -> None:
    cleaned = queue.Queue[tuple[str, bool]]()

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError as cancelled:
            cleaned.put((str(cancelled), task.cancelled))
            await asyncio.sleep(0)  # cleaning up may take time
            cleaned.put(("cleaned", task.cancelled))
            if not ends_well:
                raise

    with legs.running():
        rested = user.goal(REST)
        rested.wait_for(rested.handling.start, SOON)
        rested.kill("enough")
        assert cleaned.get(timeout=SOON) == ("its task has been killed", True)
        assert cleaned.get(timeout=SOON) == ("cleaned", True)
        with pytest.raises(TaskKilled, match="enough"):
            rested.result(SOON)
        assert rested.wait_for(rested.handling.end, SOON) is Outcome.KILLED
    assert [fact.outcome for fact in central.facts if isinstance(fact, Returned)] == [Outcome.DONE]
    assert not [fact for fact in central.facts if isinstance(fact, Failed)]
    assert not caplog.records


def raise_collision() -> None:
    raise COLLISION(Footfall(2, 0.5), "rock")


def cancel_itself() -> None:
    this = asyncio.current_task()
    assert this is not None
    this.cancel()


@pytest.mark.parametrize(
    ("error", "failure", "text"),
    [
        (raise_collision, "collision", "rock"),
        (lambda: 1 / 0, "handler error", "ZeroDivisionError: division by zero"),
        (lambda: sys.exit(3), "handler error", "SystemExit: 3"),
        (cancel_itself, "cancelled", ""),
    ],
)
def test_error_in_coroutine_fails_its_task(
    legs: Module, user: Client, error: Callable[[], object], failure: str, text: str
) -> None:
    @legs.handles(REST)
    async def rest(task: Task) -> None:
        await asyncio.sleep(0)
        error()
        await asyncio.sleep(0)

    with legs.running():
        for _ in range(2):
            with pytest.raises(TaskFailed) as failed:
                user.goal(REST).result(SOON)
            assert failed.value.failure == failure
            assert failed.value.text.startswith(text)
            assert "tca_module" not in failed.value.text


def test_lone_failure_in_task_group_is_unwrapped(legs: Module, user: Client) -> None:
    async def sleep_or_collide(number: int) -> None:
        await asyncio.sleep(0)
        if number == 1:
            raise_collision()
        await asyncio.sleep(60)

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        async with asyncio.TaskGroup() as group:
            for number in range(3):
                group.create_task(sleep_or_collide(number))

    @legs.handles(STOP)
    async def stop(task: Task) -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(sleep_or_collide(1))
            group.create_task(sleep_or_collide(1))

    with legs.running():
        with pytest.raises(TaskFailed) as failed:
            user.goal(REST).result(SOON)
        assert failed.value.data_as(COLLISION) == Footfall(2, 0.5)
        with pytest.raises(TaskFailed, match="handler error: ExceptionGroup"):
            user.command(STOP).result(SOON)


def test_background_tasks_are_cancelled_when_module_ends(legs: Module, user: Client) -> None:
    ends = queue.Queue[str]()

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        async def for_ever() -> None:
            try:
                await asyncio.Event().wait()
            finally:
                ends.put("cleaned")

        background.add(asyncio.create_task(for_ever()))
        await asyncio.sleep(0)

    background: set[asyncio.Task[None]] = set()
    with legs.running():
        user.goal(REST).result(SOON)
        assert ends.empty()
    assert ends.get(timeout=SOON) == "cleaned"


def test_system_exit_in_event_loop_ends_module(legs: Module, user: Client) -> None:
    @legs.handles(REST)
    async def rest(task: Task) -> None:
        asyncio.get_running_loop().call_soon(lambda: sys.exit(7))

    def run() -> None:
        with legs.running():
            user.goal(REST).wait(SOON)
            legs._stop.wait(SOON)

    with pytest.raises(SystemExit) as left:
        run()
    assert left.value.code == 7


def test_await_outside_async_handler_is_misuse(user: Client) -> None:
    async def script() -> float:
        return await user.query_send(TEMPERATURE)

    with pytest.raises(
        MisuseError,
        match="query 'temperature' is awaited outside of an async handler: wait for it with",
    ):
        asyncio.run(script())


def test_await_fails_when_central_is_silent(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    ended = queue.Queue[str]()

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        pending = task.query_send(TEMPERATURE)
        central.close()
        try:
            await pending
        except BaseException as error:
            ended.put(str(error))
            raise

    with legs.running(patience=0.5):
        assert user.goal(REST).id == 1
        assert "does not answer: start it with 'tca central'" in ended.get(timeout=SOON)


def test_gathered_awaits_reach_central_in_one_packet(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    asked, count, began = Query("asked", int, reply=int), 100, threading.Event()
    eyes, packets = Module("eyes", central), list[Any]()
    submit = central.submit

    def counting(connection: Any, packet: bytes) -> bool:
        packets.append([type(header) for header, _ in unpack_to_central(packet)])
        if Await in packets[-1]:
            began.set()
        return submit(connection, packet)

    @eyes.handles(asked)
    def answer(_: Task, number: int) -> int:
        assert began.wait(SOON)
        return number

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        pending = [task.query_send(asked, number) for number in range(count)]
        packets.clear()
        central.submit = counting  # type: ignore[method-assign]
        assert await asyncio.gather(*pending) == list(range(count))

    with eyes.running(), legs.running():
        user.goal(REST).result(SOON)
    assert [kinds for kinds in packets if Await in kinds] == [[Await] * count]


# --- Deadlocks through ``await`` ------------------------------------------------------------------


DRAW, MAP = Command("draw"), Command("map")
LOOK, WHERE = Query("look", reply=int), Query("where", reply=int)


@pytest.fixture(autouse=True)
def _report_waits_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let coroutines report their waits to central after 0.2 s instead of 1 s."""
    monkeypatch.setattr(coroutine_waits, "BRIEF", 0.2)


AwaitStyle = Callable[[Awaitable[Any]], Coroutine[Any, Any, Any]]


async def await_directly(awaited: Awaitable[Any]) -> Any:
    return await awaited


async def await_gathered(awaited: Awaitable[Any]) -> Any:
    return (await asyncio.gather(awaited))[0]


async def await_in_group(awaited: Awaitable[Any]) -> Any:
    async with asyncio.TaskGroup() as group:
        task = group.create_task(await_directly(awaited))
    return task.result()


async def await_in_task(awaited: Awaitable[Any]) -> Any:
    return await asyncio.create_task(await_directly(awaited))


async def await_first_completed(awaited: Awaitable[Any]) -> Any:
    done, _ = await asyncio.wait(
        [asyncio.create_task(await_directly(awaited))], return_when=asyncio.FIRST_COMPLETED
    )
    return done.pop().result()


async def await_with_timeout(awaited: Awaitable[Any]) -> Any:
    async with asyncio.timeout(SOON):
        return await awaited


class WaitCycle:
    """Two modules with one slot each. The handler of each module waits for the other module."""

    def __init__(self, central: Any, style: AwaitStyle) -> None:
        self.eyes, self.maps = Module("eyes", central), Module("maps", central)
        both = threading.Barrier(2)
        self.maps.handles(WHERE)(lambda _: 1)
        self.eyes.handles(LOOK)(lambda _: 1)

        @self.eyes.handles(DRAW)
        async def draw(task: Task) -> None:
            both.wait(SOON)
            await style(task.query_send(WHERE))

        @self.maps.handles(MAP)
        async def map_(task: Task) -> None:
            both.wait(SOON)
            await style(task.query_send(LOOK))

    def outcomes(self, user: Client) -> tuple[str, list[Outcome]]:
        """Return the failure of the handler that failed, and the outcomes of both tasks."""
        with self.eyes.running(), self.maps.running():
            refs = user.command(DRAW, sequential=False), user.command(MAP, sequential=False)
            outcomes = sorted(ref.wait(SOON) for ref in refs)
            failed = next(ref for ref in refs if ref.wait() is Outcome.FAILED)
            with pytest.raises(TaskFailed) as raised:
                failed.result()
        return f"{raised.value.failure}: {raised.value}", outcomes


@pytest.mark.parametrize(
    "style",
    [
        await_directly,
        await_gathered,
        await_in_group,
        await_in_task,
        await_first_completed,
        await_with_timeout,
    ],
)
def test_one_await_of_deadlock_is_refused_and_other_completes(
    style: AwaitStyle, central: LocalCentral, user: Client
) -> None:
    text, outcomes = WaitCycle(central, style).outcomes(user)
    assert outcomes == [Outcome.DONE, Outcome.FAILED]
    assert text.startswith("deadlock: ")
    assert "draw {" in text
    assert "map {" in text


class Device:
    """A device that releases waiting coroutines from a thread of its own."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.event = asyncio.Event()

    async def wait(self) -> None:
        self.loop = asyncio.get_running_loop()
        await self.event.wait()

    def ready(self) -> None:
        assert self.loop is not None
        self.loop.call_soon_threadsafe(self.event.set)


async def await_reply_then_device(awaited: Awaitable[Any], device: Device) -> None:
    """Await the reply. An asyncio task beside this coroutine holds the slot until the device is
    ready.
    """
    beside = asyncio.create_task(device.wait())
    await awaited
    await beside


async def await_reply_or_device(awaited: Awaitable[Any], device: Device) -> None:
    tasks = [asyncio.create_task(await_directly(awaited)), asyncio.create_task(device.wait())]
    _, waiting = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in waiting:
        task.cancel()


async def await_device(awaited: Awaitable[Any], device: Device) -> None:
    beside = asyncio.create_task(await_directly(awaited))
    await device.wait()
    beside.cancel()


async def await_shielded(awaited: Awaitable[Any], device: Device) -> None:
    beside = asyncio.ensure_future(await_directly(awaited))
    waiting = asyncio.create_task(device.wait())
    await asyncio.wait(
        [asyncio.shield(beside), asyncio.shield(waiting)], return_when=asyncio.FIRST_COMPLETED
    )
    beside.cancel()


def waiting_messages(central: LocalCentral) -> set[str]:
    """Return the messages whose coroutines central counts as waiting."""
    core = central.core
    waits = [
        wait
        for connection in list(core.blocked)
        for wait in list(connection.waits.values())
        if wait.together
    ]
    handled = [core.dispatcher.running.get(wait.origin) for wait in waits]
    return {delivery.message.name for delivery in handled if delivery is not None}


@pytest.mark.parametrize(
    "style", [await_reply_then_device, await_reply_or_device, await_device, await_shielded]
)
def test_await_beside_external_event_is_no_deadlock(
    style: Callable[[Awaitable[Any], Device], Coroutine[Any, Any, None]],
    central: LocalCentral,
    user: Client,
) -> None:
    """Central sees only waits for its own answers. A coroutine that also awaits something else must
    not count as waiting. The test observes another module's visible wait twice, which leaves time
    for a wrong report.
    """
    eyes, maps, control = (
        Module("eyes", central),
        Module("maps", central),
        Module("control", central),
    )
    made: list[Device] = []
    go_on = threading.Event()

    @eyes.handles(DRAW)
    async def draw(task: Task) -> None:
        made.append(Device())
        await style(task.query_send(WHERE), made[0])

    @maps.handles(WHERE)
    def where(task: Task) -> int:
        if style is await_reply_then_device:
            return 1 if go_on.wait(SOON) else 0
        return task.query(LOOK, timeout=SOON)

    @control.handles(MAP)
    async def map_(task: Task) -> None:
        await task.command(STOP)

    @maps.handles(STOP)
    def stop(_: Task) -> None: ...

    eyes.handles(LOOK)(lambda _: 1)
    with eyes.running(), maps.running(), control.running():
        drawing = user.command(DRAW, sequential=False)
        until(lambda: made and made[0].loop, "the coroutine awaits its device")
        for _ in range(2):
            seen = user.command(MAP, sequential=False)
            until(lambda: "map" in waiting_messages(central), "map is reported as waiting")
            assert "draw" not in waiting_messages(central)
            seen.kill("it was seen")
            until(
                lambda: "map" not in waiting_messages(central),
                "map is no longer reported as waiting",
            )
        go_on.set()
        made[0].ready()
        assert drawing.wait(SOON) is Outcome.DONE
    assert not [fact for fact in central.facts if isinstance(fact, RequestRefused)]


def test_timed_out_await_is_withdrawn_from_central(central: LocalCentral, user: Client) -> None:
    """After the timeout, the coroutine no longer counts as waiting."""
    eyes, maps, go_on = Module("eyes", central), Module("maps", central), threading.Event()
    ended: list[bool] = []

    @eyes.handles(DRAW)
    async def draw(task: Task) -> None:
        loop, deadline = asyncio.get_running_loop(), asyncio.timeout(None)

        def expire() -> None:
            until(lambda: "draw" in waiting_messages(central), "draw is reported as waiting")
            loop.call_soon_threadsafe(deadline.reschedule, 0)

        seen = threading.Thread(target=expire)
        seen.start()
        try:
            async with deadline:
                await task.query_send(WHERE)
        except TimeoutError:
            ended.append("draw" not in waiting_messages(central))

    @maps.handles(WHERE)
    def where(_: Task) -> int:
        return 1 if go_on.wait(SOON) else 0

    with eyes.running(), maps.running():
        assert user.command(DRAW).wait(SOON) is Outcome.DONE
        go_on.set()
    assert ended == [True]
