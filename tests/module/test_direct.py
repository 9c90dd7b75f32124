"""Direct messages between modules over real sockets. The journal shows central's part of them."""

import asyncio
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq
from module.real_central import SOON, Gate, RealCentral, disable_polling, until

from dev.invariants import check_invariants
from tca_module import (
    CentralLost,
    Client,
    Command,
    Inform,
    LaterReply,
    Module,
    Outcome,
    Query,
    Refused,
    Task,
    connect,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Delivered, HandledDirectly, HandlerRemoved, LostDirectly
from tca_wire.vocabulary import Condition, Refusal

HEIGHT = Query("height", float, reply=float)
DEPTH = Query("depth", float, reply=float)
POSE = Inform("pose", float)
HEARD = Inform("heard", float)
WALK = Command("walk", float, result=float)


def map_module(
    central: RealCentral | str, name: str = "map", height: Callable[[float], float] = abs
) -> Module:
    module = Module(name, central if isinstance(central, str) else central.address)
    module.handles(HEIGHT, direct=True)(lambda _, x: height(x))
    return module


@pytest.fixture
def central(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


@pytest.fixture
def user(central: RealCentral) -> Iterator[Client]:
    with connect("user", central.address) as user:
        yield user


def count_direct(central: RealCentral, message: str = "height", module: str = "") -> int:
    """Count the directly handled messages that central was notified of, optionally of one module
    only.
    """
    noted = central.facts(HandledDirectly)
    return sum(fact.message == message and module in ("", fact.module) for fact in noted)


def count_delivered(central: RealCentral) -> int:
    return len(central.facts(Delivered))


def count_lost(central: RealCentral) -> int:
    return sum(fact.number for fact in central.facts(LostDirectly))


def ask_until_direct(
    central: RealCentral, ask: Callable[[], object], message: str = "height", module: str = ""
) -> None:
    """Ask a question until it goes directly to a module, optionally to a given one."""
    before = count_direct(central, message, module)
    until(
        lambda: (ask(), count_direct(central, message, module) > before)[1],
        f"'{message}' goes directly",
    )


# --- Direct messages between working modules ------------------------------------------------------


pytestmark = pytest.mark.usefixtures("short_timeouts")


def test_queries_go_directly_once_route_is_known(central: RealCentral, user: Client) -> None:
    with map_module(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, -1.0))
        before = count_delivered(central)
        assert [user.query(HEIGHT, float(-x)) for x in range(100)] == [float(x) for x in range(100)]
        pending = [user.query_send(HEIGHT, float(x)) for x in range(100)]
        assert [one.receive(SOON) for one in pending] == [float(x) for x in range(100)]
        assert count_delivered(central) == before
        heights: list[float] = []
        note = user.query_notify(HEIGHT, -3.0, lambda _, height: heights.append(height))
        assert note.wait(SOON)
        assert heights == [3.0]
    fact = central.facts(HandledDirectly)[-1]
    assert (fact.message, fact.module, fact.resource, fact.sender, fact.size) == (
        "height",
        "map",
        "map",
        "user",
        9,
    )
    assert fact.outcome is Outcome.DONE


def test_direct_informs_keep_order_and_are_journaled(central: RealCentral, user: Client) -> None:
    seen: list[float] = []
    module = map_module(central)
    module.handles(POSE, direct=True)(lambda _, x: seen.append(x) if x >= 0 else None)
    with module.running():
        ask_until_direct(central, lambda: user.inform(POSE, -1.0), "pose")
        for number in range(500):
            user.inform(POSE, float(number))
        until(lambda: len(seen) == 500, "all informs have arrived")
        assert seen == [float(number) for number in range(500)]
    until(
        lambda: count_direct(central, "pose") > 500,
        "the leaving module reports its last direct messages",
    )
    assert not central.facts(LostDirectly)


def test_direct_query_of_handler_is_journaled_with_origin(
    central: RealCentral, user: Client
) -> None:
    walker = Module("walker", central.address)

    @walker.handles(WALK)
    def walk(task: Task, x: float) -> float:
        ask_until_direct(central, lambda: task.query(HEIGHT, x))
        return task.query(HEIGHT, x)

    with map_module(central).running(), walker.running():
        task = user.command(WALK, -2.0)
        assert task.result(SOON) == 2.0
    until(
        lambda: {fact.origin for fact in central.facts(HandledDirectly)} == {task.id},
        "every direct query is journaled",
    )


def test_coroutines_query_and_answer_directly(
    central: RealCentral, user: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    walker, eyes = Module("walker", central.address), Module("eyes", central.address)

    @eyes.handles(HEIGHT, direct=True)
    async def height(task: Task, x: float) -> float:
        await asyncio.sleep(0)
        return await task.query_send(DEPTH, x)

    @walker.handles(WALK)
    async def walk(task: Task, x: float) -> float:
        heights = await asyncio.gather(*(task.query_send(HEIGHT, x) for _ in range(20)))
        return sum(heights)

    walker.handles(DEPTH, direct=True, resource="sonar")(lambda _, x: -x)
    with walker.running(), eyes.running():
        ask_until_direct(central, lambda: user.command(WALK, -2.0).result(SOON))
        with monkeypatch.context() as patch:
            disable_polling(patch)
            assert user.command(WALK, -2.0).result(SOON) == 40.0
    until(lambda: count_direct(central, "depth"), "the direct query is journaled")


def test_direct_queries_are_tapped_until_wiretap_is_removed(
    central: RealCentral, user: Client
) -> None:
    heights: list[float] = []
    observer = Module("observer", central.address)
    observer.handles(HEARD)(lambda _, x: heights.append(x))
    with map_module(central).running(), observer.running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        tap = user.tap(Condition.WHEN_SENT, HEIGHT, HEARD)
        for x in range(1, 51):
            user.query(HEIGHT, float(x))
        until(lambda: len(heights) == 50, "the observer has all queries")
        assert heights == [float(x) for x in range(1, 51)]
        tap.remove()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))


def test_newer_handler_gets_direct_queries_until_it_leaves(
    central: RealCentral, user: Client
) -> None:
    with map_module(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, -1.0), module="map")
        with map_module(central, "better map", lambda x: x + 100).running():
            until(lambda: user.query(HEIGHT, 1.0) == 101.0, "the newer handler answers")
            ask_until_direct(central, lambda: user.query(HEIGHT, -1.0), module="better map")
        assert user.query(HEIGHT, -7.0) == 7.0
        ask_until_direct(central, lambda: user.query(HEIGHT, -1.0), module="map")


def test_leaving_module_hands_over_unbegun_direct_queries(
    central: RealCentral, user: Client
) -> None:
    """Queries wait at the entrance of a module that leaves. The next module answers each of them
    once.
    """
    gate, handled = Gate(), list[float]()

    def slow(x: float) -> float:
        handled.append(x)
        return gate() or x if x == 1.0 else x

    def quick(x: float) -> float:
        handled.append(x)
        return x + 100

    with map_module(central, "second", quick).running():
        leaving = map_module(central, "first", slow)
        thread = threading.Thread(target=leaving.run)
        thread.start()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0), module="first")
        handled.clear()
        pending = [user.query_send(HEIGHT, float(x)) for x in range(1, 6)]
        assert gate.begun.wait(SOON)
        leaving.stop()
        until(
            lambda: (user.status(), central.facts(HandlerRemoved))[1],
            "the first handler is withdrawn",
        )
        user.status()  # the answer shows that the user has been notified
        assert user.query(HEIGHT, 50.0) == 150.0
        gate.go_on.set()
        answers = [one.receive(SOON) for one in pending]
        thread.join(SOON)
    assert answers == [1.0, 102.0, 103.0, 104.0, 105.0]
    assert sorted(x for x in handled if x < 50) == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_slot_handles_direct_and_central_messages_in_turn(
    central: RealCentral, user: Client
) -> None:
    """While a direct handler waits, central delivers to its slot without knowing of the direct
    message.
    """
    diary: list[str] = []
    module, other = Module("map", central.address), Module("other", central.address)

    @module.handles(HEIGHT, direct=True)
    def height(task: Task, x: float) -> float:
        diary.append(f"height {x:g}")
        if x:
            task.query(DEPTH, x)
            assert (
                task.query(HEIGHT, 0.0) == 0.0
            )  # a query to its own resource is handled inside of the wait
        diary.append(f"end of {x:g}")
        return x

    @module.handles(WALK)
    def walk(task: Task, x: float) -> float:
        diary.append("walk")
        return task.query(HEIGHT, 0.0) if x else x

    @other.handles(DEPTH)
    def depth(task: Task, x: float) -> float:
        walk = task.command(WALK, x)
        walk.wait_for(walk.handling.start, SOON)  # the walk has been delivered
        return x

    with module.running(), other.running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        diary.clear()
        assert user.query(HEIGHT, 1.0, timeout=SOON) == 1.0
        until(lambda: len(diary) == 7, "the walk has ended")
    assert diary == ["height 1", "height 0", "end of 0", "end of 1", "walk", "height 0", "end of 0"]


def test_later_reply_to_direct_query_keeps_slot_busy(central: RealCentral, user: Client) -> None:
    module, owed = Module("map", central.address), list[LaterReply[float]]()

    @module.handles(HEIGHT, direct=True)
    def height(task: Task, x: float) -> LaterReply[float]:
        owed.append(task.reply_later())
        return owed[-1]

    module.handles(WALK)(lambda _, x: x)

    def ask() -> None:
        pending = user.query_send(HEIGHT, 0.0)
        until(lambda: owed, "the handler was called")
        assert not owed[-1].cancelled
        owed.pop().reply(0.0)
        pending.receive(SOON)

    with module.running():
        ask_until_direct(central, ask)
        one, two, walk = (
            user.query_send(HEIGHT, 1.0),
            user.query_send(HEIGHT, 2.0),
            user.command(WALK, 3.0),
        )
        walk.wait_for(walk.handling.start, SOON)  # central has delivered the walk
        until(lambda: owed, "the handler was called")
        assert len(owed) == 1
        owed.pop().reply(1.5)
        assert one.receive(SOON) == 1.5
        assert walk.result(SOON) == 3.0
        until(lambda: owed, "the handler was called again")
        owed.pop().reply(2.5)
        assert two.receive(SOON) == 2.5


def test_overloaded_receiver_refuses_queries_and_drops_informs(
    central: RealCentral, user: Client
) -> None:
    gate, seen = Gate(), list[float]()
    go_on = gate.go_on
    module = map_module(central, height=lambda x: gate() or x)
    module.handles(POSE, direct=True)(lambda _, x: seen.append(x) if x >= 0 else None)
    with module.running():
        go_on.set()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        ask_until_direct(central, lambda: user.inform(POSE, -1.0), "pose")
        until(lambda: user.query(HEIGHT, 0.0) == 0.0, "all messages are handled")
        go_on.clear()
        pending = [user.query_send(HEIGHT, 1.0) for _ in range(500)]
        for number in range(1000):
            user.inform(POSE, float(number))
        with pytest.raises(
            Refused, match=r"\d+ direct messages wait for the handler of 'height'"
        ) as refused:
            user.query(HEIGHT, 2.0)
        assert refused.value.refusal is Refusal.OVERLOAD
        go_on.set()
        assert [one.receive(SOON) for one in pending] == [1.0] * 500
        until(lambda: user.query(HEIGHT, 3.0) == 3.0, "the handler answers again")
        lost = 1000 - len(seen)
        assert lost >= 500 - 64
        assert seen == [float(number) for number in range(len(seen))]
        until(
            lambda: (user.status(), count_lost(central) == lost)[1],
            "central knows the number of lost informs",
        )


def test_direct_query_times_out_and_cancelled_one_is_skipped(
    central: RealCentral, user: Client
) -> None:
    go_on, handled = threading.Event(), list[float]()

    def slow(x: float) -> float:
        handled.append(x)
        go_on.wait(SOON)
        return x

    with map_module(central, height=slow).running():
        go_on.set()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        go_on.clear()
        at_work = user.query_send(HEIGHT, 1.0)
        until(lambda: 1.0 in handled, "the handler has begun")
        with pytest.raises(TimeoutError, match="was not answered within"):
            at_work.receive(0.05)
        user.query_send(HEIGHT, 2.0).cancel()
        go_on.set()
        assert user.query(HEIGHT, 3.0) == 3.0
    assert 2.0 not in handled


def test_direct_queries_reach_all_slots(central: RealCentral, user: Client) -> None:
    names: set[str] = set()
    module = Module("map", central.address, capacity=3)

    @module.handles(HEIGHT, direct=True)
    def height(_: Task, x: float) -> float:
        names.add(threading.current_thread().name)
        return x

    with module.running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        until(lambda: (user.query(HEIGHT, 0.0), len(names) == 3)[1], "all slots have answered")


# --- Direct messages after breaks, deaths and foreign packets -------------------------------------


def test_direct_route_is_relearnt_after_connection_break(
    central: RealCentral, user: Client
) -> None:
    with map_module(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        connection = user._connection()
        connection.session.break_off()
        assert user.query(HEIGHT, -1.0) == 1.0  # still answered while the connection is away
        user.status()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))


def test_direct_queries_are_answered_while_central_is_away(tmp_path: Path) -> None:
    """A query that is open when another central starts is lost, as a query through central is. Then
    routes are learnt again.
    """
    address = f"ipc://{tmp_path}/central.sock"
    gate = Gate()
    central = RealCentral(address)
    module = map_module(address, height=lambda x: gate() or x if x < 0 else x)
    with module.running(), connect("user", address) as user:
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        central.close()
        for x in range(100):
            assert user.query(HEIGHT, float(x)) == x
        pending = user.query_send(HEIGHT, -1.0)
        assert gate.begun.wait(SOON)
        with RealCentral(address, "another run") as central:
            with pytest.raises(CentralLost, match="central was restarted and has forgotten it"):
                pending.receive(SOON)
            gate.go_on.set()
            ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))


def entrance_path(folder: Path) -> Path:
    (path,) = folder.glob("*.direct")
    return path


def test_stranger_at_entrance_is_refused_and_harmless(
    central: RealCentral, user: Client, tmp_path: Path
) -> None:
    with map_module(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        path = entrance_path(tmp_path)
        assert path.stat().st_mode & 0o777 == 0o600
        with zmq.Context() as context, context.socket(zmq.DEALER) as stranger:
            stranger.connect(f"ipc://{path}")
            for frames in (
                [b"garbage"],
                [b""],
                [b"a", b"b", b"c"],
                [os.urandom(1000)],
                [b"\xff" * 16],
            ):
                stranger.send_multipart(frames)
                assert stranger.poll(int(SOON * 1000))
                assert b"protocol" in stranger.recv()
        assert user.query(HEIGHT, -2.0) == 2.0
    until(lambda: not path.exists(), "the entrance is gone")


def test_stale_entrance_sockets_are_removed(central: RealCentral, tmp_path: Path) -> None:
    with zmq.Context() as context, context.socket(zmq.ROUTER) as alive:
        gone, taken, foreign = (
            tmp_path / f"{name}.direct" for name in ("4194305-a", "4194306-b", "notes")
        )
        alive.bind(f"ipc://{gone}")
        gone_too = tmp_path / "4194307-c.direct"
        gone.rename(gone_too)  # like a process on another machine, it still answers
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(taken))
        foreign.touch()
        with map_module(central).running():
            assert not taken.exists()
            assert gone_too.exists()
            assert foreign.exists()


def test_tcp_entrance_uses_host_of_central(tmp_path: Path) -> None:
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address) as user:
        with map_module(central).running():
            ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
            ((path,),) = user._connection().direct.routes._routes.values()
            assert path.entrance.endpoint.startswith("tcp://127.0.0.1:")
        assert not list(tmp_path.iterdir())


def test_too_long_socket_path_only_disables_direct_messages(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path
    while len(str(folder)) < 84:
        folder = folder / ("x" * min(10, 84 - len(str(folder))))
    folder.mkdir(parents=True)
    with RealCentral(f"ipc://{folder}/c") as central, connect("user", central.address) as user:
        with map_module(central).running():
            assert user.query(HEIGHT, -1.0) == 1.0
        assert "all go through central" in caplog.text


def test_local_central_routes_direct_queries_itself() -> None:
    with LocalCentral(check=check_invariants) as central, connect("user", central) as user:
        module = Module("map", central)
        module.handles(HEIGHT, direct=True)(lambda _, x: -x)
        with module.running():
            assert [user.query(HEIGHT, 1.0) for _ in range(5)] == [-1.0] * 5
        assert sum(isinstance(fact, Delivered) for fact in central.facts) == 5
