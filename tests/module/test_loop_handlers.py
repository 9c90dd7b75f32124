"""Handlers on the user's own event loop, with a central behind a real socket."""

import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import SOON, RealCentral

from tca_module import (
    AsyncTask,
    Command,
    Failure,
    Goal,
    MisuseError,
    Module,
    Outcome,
    Query,
    Task,
    TaskFailed,
    aconnect,
)

TRIP, LEG, REST = Goal("trip", int), Command("leg", int, result=int, progress=int), Goal("rest")
SUM = Command("sum", int, result=int)
WHERE, STUCK = Query("where", int, reply=int), Failure("stuck", int)


@pytest.fixture
def central(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


@pytest.fixture
def legs(central: RealCentral) -> Iterator[Module]:
    legs = Module("legs", central.address, capacity=2)

    @legs.handles(LEG)
    def leg(task: Task, number: int) -> int:
        if number < 0:
            raise STUCK(number)
        return 2 * number

    legs.handles(WHERE)(lambda _, number: -number)
    with legs.running():
        yield legs


@pytest.fixture
def planner(central: RealCentral, legs: Module) -> Module:
    return Module("planner", central.address)


def test_loop_handler_awaits_a_task_of_its_own_resource(
    planner: Module, central: RealCentral
) -> None:
    @planner.handles_on_loop(LEG)
    async def leg(_: AsyncTask, number: int) -> int:
        return 3 * number

    @planner.handles_on_loop(SUM)
    async def total(task: AsyncTask, number: int) -> int:
        return sum([await (await task.command(LEG, one)).result(SOON) for one in range(number)])

    async def main() -> int:
        async with planner.running_async() as sender:
            return await (await sender.command(SUM, 4)).result(SOON)

    assert asyncio.run(main()) == 18


def test_handler_on_users_loop_awaits_its_own_client(planner: Module, central: RealCentral) -> None:
    seen: list[object] = []
    own = aconnect("own", central.address)

    @planner.handles_on_loop(TRIP)
    async def trip(task: AsyncTask, number: int) -> None:
        seen.append((asyncio.get_running_loop(), threading.current_thread()))
        seen.append(await asyncio.gather(own.query(WHERE, 1), task.query(WHERE, number)))
        leg = await task.command(LEG, number)
        seen.append(await leg.result(SOON))

    async def main() -> None:
        async with planner.running_async() as sender, own:
            assert await (await sender.goal(TRIP, 4)).wait(SOON) is Outcome.DONE
            assert seen[0] == (asyncio.get_running_loop(), threading.main_thread())

    asyncio.run(main())
    assert seen[1:] == [[-1, -4], 8]


def test_failure_of_a_subtask_fails_the_handler(planner: Module) -> None:
    @planner.handles_on_loop(TRIP)
    async def trip(task: AsyncTask, number: int) -> None:
        await (await task.command(LEG, number)).result(SOON)

    async def main() -> None:
        async with planner.running_async() as sender:
            with pytest.raises(TaskFailed, match="stuck"):
                await (await sender.goal(TRIP, -3)).result(SOON)

    asyncio.run(main())


def test_killed_handler_cleans_up_before_its_task_ends(planner: Module) -> None:
    cleaned_up: list[int] = []
    has_begun = asyncio.Event()

    @planner.handles_on_loop(REST)
    async def rest(task: AsyncTask) -> None:
        has_begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            cleaned_up.append(await task.query(WHERE, 5))

    async def main() -> None:
        async with planner.running_async() as sender:
            resting = await sender.goal(REST)
            await asyncio.wait_for(has_begun.wait(), SOON)  # else it would never run
            await resting.kill("enough")
            await resting.wait_for(resting.handling.end, SOON)
            assert await resting.wait(SOON) is Outcome.KILLED
            async with sender.lock("planner", timeout=SOON):  # its slot is free
                assert cleaned_up == [-5]

    asyncio.run(main())


def test_end_of_the_block_cancels_the_handlers(planner: Module, central: RealCentral) -> None:
    ended: list[str] = []
    begun = asyncio.Event()

    @planner.handles_on_loop(REST)
    async def rest(task: AsyncTask) -> None:
        try:
            begun.set()
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            ended.append("cleaned up")

    async def main() -> None:
        async with aconnect("user", central.address) as user:
            async with planner.running_async():
                resting = await user.goal(REST)
                await asyncio.wait_for(begun.wait(), SOON)
            ended.append("block")
            with pytest.raises(TaskFailed, match="module lost"):
                await resting.result(SOON)

    asyncio.run(main())
    assert ended == ["cleaned up", "block"]


def test_progress_is_reported_from_the_loop(planner: Module, central: RealCentral) -> None:
    steps = Command("steps", int, result=str, progress=int)

    @planner.handles_on_loop(steps)
    async def take(task: AsyncTask, number: int) -> str:
        await followed.wait()
        for step in range(number):
            await task.report(step)
        return "there"

    followed = asyncio.Event()

    async def main() -> list[object]:
        async with planner.running_async() as sender:
            sent = await sender.command(steps, 3)
            async with sent.progress(int) as progress:
                followed.set()
                return [*[step async for step in progress], await sent.result(SOON)]

    assert asyncio.run(main()) == [0, 1, 2, "there"]


def test_stop_ends_arun_and_the_module_runs_again(planner: Module, central: RealCentral) -> None:
    @planner.handles_on_loop(REST)
    async def rest(task: AsyncTask) -> None: ...

    async def main() -> None:
        async with aconnect("user", central.address) as user:
            for _ in range(2):
                running = asyncio.create_task(planner.arun())
                await user.wait_until_handled(REST, timeout=SOON)
                assert await (await user.goal(REST)).wait(SOON) is Outcome.DONE
                planner.stop()
                await asyncio.wait_for(running, SOON)

    asyncio.run(main())


def test_signal_ends_arun(planner: Module, central: RealCentral) -> None:
    async def main() -> None:
        running = asyncio.create_task(planner.arun())
        async with aconnect("user", central.address) as user:
            while "planner" not in {module.name for module in await user.modules()}:
                pass
            os.kill(os.getpid(), signal.SIGTERM)
            await asyncio.wait_for(running, SOON)

    asyncio.run(main())
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_loop_handlers_need_a_loop(planner: Module) -> None:
    @planner.handles_on_loop(REST)
    async def rest(task: AsyncTask) -> None: ...

    with pytest.raises(MisuseError, match="arun"):
        planner.run()


def test_plain_function_is_refused_as_a_loop_handler(planner: Module) -> None:
    with pytest.raises(MisuseError, match="handles"):
        planner.handles_on_loop(REST)(lambda _: None)  # type: ignore[arg-type, return-value]
