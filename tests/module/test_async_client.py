"""An AsyncClient on the user's own event loop, with a central behind a real socket."""

import asyncio
import gc
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, disable_polling, until

from tca_module import (
    AsyncClient,
    Broadcast,
    CentralLost,
    Command,
    Inform,
    LockLost,
    MisuseError,
    Module,
    MultiQuery,
    Outcome,
    Query,
    QueryFailed,
    Refused,
    Stopped,
    Task,
    TaskFailed,
    Timeout,
    Variable,
    aconnect,
    this,
)

NEXT, NEVER = Query("next", int, reply=int), Query("never", reply=int)
BIDS, LEVEL = MultiQuery("bids", reply=int), Variable("level", float)
MOVE, HOLD = Command("move", int, result=str, progress=int), Command("hold")
SAY, CALL = Inform("say", str), Broadcast("call", str)


async def soon(condition: Callable[[], Any], description: str) -> None:
    """Wait until a condition holds, while the loop runs."""
    await asyncio.to_thread(until, condition, description)


class Robot:
    """A central and a module."""

    def __init__(self, central: RealCentral) -> None:
        self.central, self.heard = central, list[str]()
        self.module = Module("robot", central.address, capacity=4)
        self.given_up = threading.Event()
        self.released = threading.Event()
        self.module.handles(NEXT)(self.next)
        self.module.handles(NEVER, resource="slow")(self.never)
        self.module.handles(BIDS)(lambda _: 7)
        self.module.handles(MOVE, resource="arm", takes=["update"])(self.move)
        self.module.handles(HOLD, resource="gripper")(lambda _: None)
        self.module.handles(SAY)(lambda _, text: self.heard.append(text))
        self.module.handles(CALL)(lambda _, text: self.heard.append(text))

    def next(self, _: Task, number: int) -> int:
        if number < 0:
            raise ValueError(number)
        return number + 1

    async def never(self, task: Task) -> int:
        try:
            await asyncio.Event().wait()
        finally:
            self.given_up.set()
        return 0

    def move(self, task: Task, steps: int) -> str:
        if steps < 0:
            raise ValueError(steps)
        for step in range(steps):
            task.report(step)
        if steps == 0:
            request = task.wait_for_request(SOON)
            assert request is not None
            request.accept()
            return "updated"
        return "moved"

    def client(self, **options: Any) -> AsyncClient:
        return aconnect("user", self.central.address, **options)

    @property
    def waiting(self) -> list[Any]:
        return self.central.open_requests_of("user")


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        robot = Robot(central)
        with robot.module.running():
            yield robot


def test_hundred_queries_are_answered_together(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> list[int]:
        async with robot.client() as user:
            return await asyncio.gather(*(user.query(NEXT, one) for one in range(100)))

    disable_polling(monkeypatch)
    assert asyncio.run(main()) == list(range(1, 101))


def test_each_kind_of_call_returns_what_the_client_returns(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client() as user:
            await user.wait_until_handled(MOVE, timeout=SOON)
            await user.set_variable(LEVEL, 0.5)
            assert await user.get_variable(LEVEL) == 0.5
            assert await user.swap_variable(LEVEL, 0.6) == 0.5
            assert await user.multi_query(BIDS, timeout=SOON) == [7]
            await user.inform(SAY, "hello", wait=SOON)
            await user.broadcast(CALL, "all", wait=SOON)
            assert {info.name for info in await user.modules()} == {"robot", "user"}
            assert (await user.status("tree")) is not None
            assert await user.call(lambda client: client.name) == "user"
            sent = await user.command(MOVE, 3, keep=True, suspended=True)
            async with sent.progress(int) as steps:
                await sent.resume()
                assert [step async for step in steps] == [0, 1, 2]
            assert await sent.result(SOON) == "moved"
            assert await sent.wait() is Outcome.DONE
            found = await user.task(sent.id)
            assert found is not None
            assert await found.data(MOVE) == 3

    asyncio.run(main())
    # four slots: either may be handled first
    until(lambda: sorted(robot.heard) == ["all", "hello"], "both statements are handled")


def test_failures_are_raised_where_they_are_awaited(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client() as user:
            with pytest.raises(QueryFailed, match="ValueError"):
                await user.query(NEXT, -1)
            failing = await user.command(MOVE, -1)
            with pytest.raises(TaskFailed, match="ValueError"):
                await failing.result(SOON)
            with pytest.raises(Timeout, match="slow handles it"):
                await user.query(NEVER, timeout=0.05)
            with pytest.raises(Refused):
                await user.command(HOLD, constraints=[this.handling.end <= this.handling.start])
            with pytest.raises(MisuseError, match="timeout"):
                await user.query(NEXT, 1, timeout="long")  # type: ignore[call-overload]

    asyncio.run(main())


def test_cancelled_query_is_given_up(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client() as user:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.05):
                    await user.query(NEVER)
            await soon(lambda: not robot.waiting, "central has forgotten the query")
            assert await user.query(NEXT, 1) == 2

    asyncio.run(main())


def test_task_whose_send_is_cancelled_is_killed(robot: Robot) -> None:
    """The send is cancelled at each of its stages."""

    async def main() -> None:
        async with robot.client() as user, user.lock("gripper"):
            for turns in range(30):
                sending = asyncio.create_task(user.command(HOLD))
                for _ in range(turns):
                    await asyncio.sleep(0.00005)
                sending.cancel()
                await asyncio.wait([sending])
                if not sending.cancelled():
                    await sending.result().kill()
            async with asyncio.timeout(SOON):
                while await user.tasks():
                    pass

    asyncio.run(main())


def test_asyncio_tasks_hold_a_lock_one_after_the_other(robot: Robot) -> None:
    inside: list[int] = []

    async def main() -> None:
        async def use(number: int) -> None:
            async with user.lock("gripper", timeout=SOON) as claim:
                inside.append(number)
                await user.query(NEXT, number)
                assert claim.held
                inside.append(number)

        async with robot.client() as user:
            await asyncio.gather(*map(use, range(4)))

    asyncio.run(main())
    assert inside == [0, 0, 1, 1, 2, 2, 3, 3]


def test_cancelled_lock_is_free_again(robot: Robot) -> None:
    async def main() -> None:
        async def hold() -> None:
            async with user.lock("gripper"):
                held.set()
                await asyncio.Event().wait()

        async with robot.client() as user, robot.client() as other:
            for _ in range(3):
                held = asyncio.Event()
                holding = asyncio.create_task(hold())
                waiting = asyncio.create_task(hold())
                await held.wait()
                with pytest.raises(Timeout, match="gripper"):
                    async with user.lock("gripper", timeout=0.01):
                        pass
                waiting.cancel()
                holding.cancel()
                await asyncio.wait([holding, waiting])
                async with other.lock("gripper", timeout=SOON):
                    pass

    asyncio.run(main())


def test_grant_that_meets_a_cancellation_is_released(robot: Robot) -> None:
    """The request is cancelled at each of its stages, so once the grant is on its way."""

    async def main() -> None:
        async with robot.client() as user, robot.client() as other:
            for turns in range(40):
                taking = asyncio.create_task(user.lock("gripper").__aenter__())
                for _ in range(turns):
                    await asyncio.sleep(0.00005)
                taking.cancel()
                await asyncio.wait([taking])
                if taking.cancelled():
                    async with other.lock("gripper", timeout=SOON):
                        pass
                else:
                    break
            else:
                pytest.fail("the lock was never granted")

    asyncio.run(main())
    gc.collect()


def test_lost_lock_is_raised_at_the_end_of_the_block(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client() as user:
            with pytest.raises(LockLost):  # noqa: PT012 - the end of the block raises
                async with user.lock("gripper") as claim:
                    await user.call(lambda client: client.unlock("gripper"))
                    await soon(lambda: not claim.held, "the client hears of it")

    asyncio.run(main())


def test_update_and_changes_of_a_task_are_awaited(robot: Robot) -> None:
    async def main() -> list[str]:
        async with robot.client() as user, user.observe(MOVE, states=["running"]) as observed:
            moving = await user.command(MOVE, 0)
            async with moving.changes() as changes:
                states = [(await anext(observed)).state]
                await moving.update(5, timeout=SOON)
                states += [change.state async for change in changes]
            assert await moving.result(SOON) == "updated"
            assert await moving.state == "done"
            with pytest.warns(RuntimeWarning, match="never awaited"):
                assert moving.state != "done"  # type: ignore[comparison-overlap]
            return states

    states = asyncio.run(main())
    assert states[0] == "running"
    assert states[-1] == "done"


def test_step_that_is_cancelled_loses_no_element(robot: Robot) -> None:
    async def main() -> list[int]:
        async with robot.client() as user, user.lock("arm"):
            moving = await user.command(MOVE, 50)
            steps = moving.progress(int)
            for _ in range(3):
                with pytest.raises(Timeout):
                    await anext(moving.progress(int, timeout=0.01))
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.01):
                        await anext(steps)
            await user.call(lambda client: client.unlock("arm"))
            seen = list[int]()
            while len(seen) < 50:
                try:
                    async with asyncio.timeout(0.0):
                        seen.append(await anext(steps))
                except TimeoutError:
                    await asyncio.sleep(0)
            return seen

    with pytest.raises(LockLost):
        asyncio.run(main())


def test_close_ends_open_awaits_with_stopped(robot: Robot) -> None:
    async def main() -> None:
        user = await robot.client().open()
        waiting = [asyncio.create_task(user.query(NEVER)) for _ in range(3)]
        async with user.lock("gripper"):
            await soon(lambda: len(robot.waiting) >= 3, "central has the queries")
            await user.close()
            errors = await asyncio.gather(*waiting, return_exceptions=True)
            assert [type(error) for error in errors] == [Stopped] * 3
            raise Stopped("the lock ended with the connection")

    with pytest.raises(Stopped, match="the lock ended"):
        asyncio.run(main())
    until(lambda: not robot.waiting, "central has forgotten the queries")


def test_use_outside_of_the_block_is_misuse(robot: Robot) -> None:
    async def main() -> None:
        user = robot.client()
        with pytest.raises(MisuseError, match="not open"):
            await user.query(NEXT, 1)
        async with user:
            pass
        with pytest.raises(MisuseError, match="closed"):
            await user.query(NEXT, 1)

    asyncio.run(main())


def test_error_of_the_block_is_raised_unchanged(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client():
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        asyncio.run(main())


def test_opening_without_central_leaves_no_thread(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(CentralLost, match="tca central"):
            await aconnect("user", f"ipc://{tmp_path}/none.sock", 0.05).open()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await aconnect("user", f"ipc://{tmp_path}/none.sock", 0.3).open()

    before = threading.active_count()
    asyncio.run(main())
    until(lambda: threading.active_count() == before, "both threads have ended")


def test_two_loops_in_two_threads_share_one_client(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client() as user:

            async def ask() -> list[int]:
                return list(await asyncio.gather(*(user.query(NEXT, one) for one in range(20))))

            there = asyncio.to_thread(lambda: asyncio.run(ask()))
            assert list(await asyncio.gather(ask(), there)) == [list(range(1, 21))] * 2

    asyncio.run(main())


def test_new_central_ends_lost_queries_and_answers_later_ones(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        async with robot.client() as user:
            waiting = asyncio.create_task(user.query(NEVER))
            await soon(lambda: robot.waiting, "central has the query")
            await asyncio.to_thread(robot.central.close)
            later = asyncio.create_task(user.get_variable(LEVEL, default=0.1))
            with RealCentral(robot.central.address, "new"):
                with pytest.raises(CentralLost, match="never"):
                    await waiting
                assert await later == 0.1
                await user.wait_until_handled(NEXT, timeout=SOON)
                assert await user.query(NEXT, 4, timeout=SOON) == 5

    asyncio.run(main())


def test_loop_is_not_blocked_while_central_is_away(robot: Robot) -> None:
    async def main() -> None:
        async with robot.client(patience=0.5, linger=0.1) as user:
            assert await user.query(NEXT, 1) == 2
            await asyncio.to_thread(robot.central.close)
            turns, asking = 0, asyncio.create_task(user.get_variable(LEVEL, default=0.0))
            while not asking.done():
                await asyncio.sleep(0.01)
                turns += 1
            with pytest.raises(CentralLost):
                await asking
            assert turns > 10

    asyncio.run(main())


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_forked_process_gets_misuse(robot: Robot) -> None:
    async def in_child(user: AsyncClient) -> None:
        with pytest.raises(MisuseError, match=r"connect\(\) in each process"):
            await user.query(NEXT, 1)
        await user.close()

    async def main() -> int:
        async with robot.client() as user:
            await user.query(NEXT, 1)
            if (child := os.fork()) == 0:
                code = 1
                try:
                    asyncio.events._set_running_loop(None)
                    asyncio.new_event_loop().run_until_complete(in_child(user))
                    code = 0
                finally:
                    os._exit(code)
            return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])  # noqa: ASYNC222

    assert asyncio.run(main()) == 0
