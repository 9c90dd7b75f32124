"""A client that several threads share, with a central behind a real socket."""

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, until

from tca_module import Client, Command, MisuseError, Module, Query, connect

NEXT, NEVER = Query("next", int, reply=int), Query("never", reply=int)
MOVE = Command("move", int, result=int)
THREADS = 20


@pytest.fixture
def central(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


@pytest.fixture
def robot(central: RealCentral) -> Iterator[threading.Event]:
    """Run a module. The event lets its handler of NEVER return."""
    robot, end = Module("robot", central.address, capacity=4), threading.Event()
    robot.handles(NEXT)(lambda _, number: number + 1)
    robot.handles(MOVE, resource="arm")(lambda _, number: 2 * number)
    robot.handles(NEVER, resource="slow")(lambda _: int(end.wait(SOON)))
    with robot.running():
        yield end
        end.set()


def connections_of(central: RealCentral, name: str) -> list[Any]:
    connections = list(central.server.central.registry.connections.values())
    return [one for one in connections if one.module.name == name]


@pytest.mark.usefixtures("robot")
def test_twenty_threads_share_one_client(central: RealCentral) -> None:
    all_there = threading.Barrier(THREADS)

    def work(number: int) -> tuple[int, int | None, list[str]]:
        all_there.wait(SOON)
        with user.parallel():
            move = user.command(MOVE, number, sequential=False)
        with user.lock("arm", timeout=SOON):
            reply = user.query(NEXT, number, timeout=SOON)
        return reply, move.result(SOON), [module.name for module in user.modules()]

    with connect("user", central.address, threads=True) as user:
        with ThreadPoolExecutor(THREADS) as pool:
            done = list(pool.map(work, range(THREADS)))
        assert done == [(one + 1, 2 * one, ["robot", "user"]) for one in range(THREADS)]
        assert user.query(NEXT, 7) == 8
    until(lambda: not connections_of(central, "user"), "all connections are closed")


@pytest.mark.usefixtures("robot")
def test_threads_come_and_go_like_those_of_requests(central: RealCentral) -> None:
    """Each opening closes the connections of ended threads, while others do the same."""
    with connect("user", central.address, threads=True) as user:
        started: list[threading.Thread] = []
        done: list[int] = []
        for number in range(120):
            ask = partial(user.query, NEXT, number)
            started.append(threading.Thread(target=lambda ask=ask: done.append(ask())))
            started[-1].start()
        for thread in started:
            thread.join(SOON)
    assert sorted(done) == list(range(1, 121))


@pytest.mark.usefixtures("robot")
def test_connection_of_ended_thread_closes_at_next_opening(central: RealCentral) -> None:
    with connect("user", central.address, threads=True) as user:
        for number in range(5):
            with ThreadPoolExecutor(1) as pool:
                assert pool.submit(user.query, NEXT, number).result(SOON) == number + 1
        until(lambda: len(connections_of(central, "user")) == 2, "the earlier ones are closed")


@pytest.mark.usefixtures("robot")
def test_client_is_used_after_its_opening_thread_ended(central: RealCentral) -> None:
    def opened() -> Client:
        return connect("user", central.address, threads=True)

    with ThreadPoolExecutor(1) as pool:
        user = pool.submit(opened).result(SOON)
    with connect("other", central.address):  # closes the abandoned clients
        assert user.query(NEXT, 1) == 2
    user.close()
    until(lambda: not connections_of(central, "user"), "all connections are closed")


def test_close_spares_the_thread_that_waits(
    central: RealCentral, robot: threading.Event, caplog: pytest.LogCaptureFixture
) -> None:
    def wait() -> int:
        reply = user.query(NEVER)
        with pytest.raises(MisuseError, match="closed"):
            user.query(NEXT, 1)
        return reply

    with ThreadPoolExecutor(1) as pool:
        with connect("user", central.address, linger=0.05, threads=True) as user:
            waiting = pool.submit(wait)
            until(lambda: central.open_requests_of("user"), "the thread waits")
        assert "still waits" in caplog.text
        robot.set()
        assert waiting.result(SOON) == 1


@pytest.mark.usefixtures("robot")
def test_idle_thread_is_closed_with_the_client(central: RealCentral) -> None:
    with ThreadPoolExecutor(1) as pool:
        with connect("user", central.address, threads=True) as user:
            assert pool.submit(user.query, NEXT, 1).result(SOON) == 2
        until(lambda: not connections_of(central, "user"), "both connections are closed")
        with pytest.raises(MisuseError, match="closed"):
            pool.submit(user.query, NEXT, 1).result(SOON)


@pytest.mark.usefixtures("robot")
def test_error_in_wrong_thread_names_the_shared_client(central: RealCentral) -> None:
    with connect("user", central.address) as user, ThreadPoolExecutor(1) as pool:
        with pytest.raises(MisuseError, match="threads=True"):
            pool.submit(user.query, NEXT, 1).result(SOON)


@pytest.mark.usefixtures("robot")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_forked_process_gets_misuse(central: RealCentral) -> None:
    with connect("user", central.address, threads=True) as user:
        assert user.query(NEXT, 1) == 2
        if (child := os.fork()) == 0:
            code = 1
            try:
                with pytest.raises(MisuseError, match=r"connect\(\) in each process"):
                    user.query(NEXT, 1)
                user.close()
                code = 0
            finally:
                os._exit(code)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
