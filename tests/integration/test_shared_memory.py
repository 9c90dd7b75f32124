"""Large data between modules and a real central: each kind of message, restarts and deaths."""

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from processes import Central, central, program
from waiting import SOON, wait_until

from tca_module import (
    Broadcast,
    Client,
    Command,
    Failure,
    Inform,
    MisuseError,
    Module,
    NotSent,
    Query,
    QueryFailed,
    Task,
    TaskFailed,
    Timeout,
    Variable,
    connect,
)
from tca_wire.journal import facts
from tca_wire.packets.large import held_size, is_large
from tca_wire.text.bodies import plain_data

pytestmark = pytest.mark.slow

Image = NDArray[np.uint8]
SIZES = pytest.mark.parametrize("size", [100 << 10, 1 << 20, 6_000_000])

ECHO = Query("echo", Image, reply=Image)
PICTURE = Inform("picture", Image)
TELL = Broadcast("tell", Image)
GRIP = Command("grip", Image, result=Image, progress=Image)
SLIPPED = Failure("slipped", Image)
MAP = Variable("map", Image)


def image(value: int, size: int) -> Image:
    return np.resize(np.arange(value, value + 251, dtype=np.uint8), size)


def is_image(found: Any, value: int, size: int) -> bool:
    return not found.flags.writeable and np.array_equal(found, image(value, size))


class Received:
    """The images that a handler has received, and those that are awaited."""

    def __init__(self) -> None:
        self.images: list[Image] = []
        self.has_more = threading.Semaphore(0)

    def __call__(self, _: object, found: Image) -> None:
        self.images.append(found)
        self.has_more.release()

    def next(self) -> Image:
        assert self.has_more.acquire(timeout=SOON)
        return self.images.pop(0)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Central]:
    """Run a central, which must leave no shared memory behind."""
    with central(tmp_path) as running:
        with connect("observer", running.address) as user:
            store = store_of(user)
        assert store.exists()
        yield running
        running.stop()
    assert not store.exists()


@pytest.fixture
def user(running: Central) -> Iterator[Client]:
    with connect("user", running.address) as user:
        yield user


def store_of(user: Client) -> Path:
    pool = user._open_link().line.large._pool
    assert pool is not None, "memory is shared"
    return Path(pool.folder).parent


def segments(user: Client) -> list[str]:
    """Return the segments that somebody needs."""
    found = (path.name for path in store_of(user).glob("*/*"))
    return [name for name in found if not name.endswith(".free")]


def until_free(user: Client, held: int = 0) -> None:
    """Wait until central holds only *held* segments."""
    user.status()  # central keeps the answer to the newest request of each connection
    wait_until(lambda: len(segments(user)) == held)


@SIZES
def test_query_and_reply_carry_large_data(running: Central, user: Client, size: int) -> None:
    eyes = Module("eyes", running.address)
    eyes.handles(ECHO)(lambda _, found: found + 1)
    with eyes.running():
        kept = [user.query(ECHO, image(value, size)) for value in range(10)]
        assert all(is_image(found, value + 1, size) for value, found in enumerate(kept))
        until_free(user)
    assert is_image(kept[0], 1, size), "after the end of its sender"


@SIZES
def test_informs_carry_large_data_in_order(running: Central, user: Client, size: int) -> None:
    eyes, received = Module("eyes", running.address), Received()
    eyes.handles(PICTURE)(received)
    with eyes.running():
        for value in range(20):
            user.inform(PICTURE, image(value, size))
        assert all(is_image(received.next(), value, size) for value in range(20))
        until_free(user)


@SIZES
def test_broadcast_reaches_all_from_one_segment(running: Central, user: Client, size: int) -> None:
    modules = [Module(name, running.address) for name in ("a", "b", "c")]
    received = [Received() for _ in modules]
    for module, one in zip(modules, received, strict=True):
        module.handles(TELL)(one)
    with modules[0].running(), modules[1].running(), modules[2].running():
        user.broadcast(TELL, image(1, size))
        found = [one.next() for one in received]
        assert all(is_image(one, 1, size) for one in found)
        inodes = {line.split()[4] for line in mapped(store_of(user)) if " r--s " in line}
        assert len(inodes) == (1 if size > 512 << 10 else 0), "a receiver copies small ones"
        until_free(user)
        user.broadcast(TELL, image(2, size))  # while the first images are in use
        assert all(is_image(one.next(), 2, size) for one in received)
        assert all(is_image(one, 1, size) for one in found)
        until_free(user)


def mapped(store: Path) -> list[str]:
    return [one for one in Path("/proc/self/maps").read_text().splitlines() if str(store) in one]


@SIZES
def test_task_carries_large_data(running: Central, user: Client, size: int) -> None:
    arm, begun = Module("arm", running.address), threading.Event()

    @arm.handles(GRIP)
    def grip(task: Task, found: Image) -> Image:
        changing = found.copy()
        for value in range(3):
            changing[:] = image(value, size)
            task.report(changing)
        begun.set()
        if found[0] == 9:
            raise SLIPPED(found)
        return found

    with arm.running():
        sent = user.command(GRIP, image(5, size), keep=True)
        seen = list(sent.progress())  # the first ones may be missed
        assert is_image(seen[-1], 2, size)
        assert all(is_image(one, int(one[0]), size) for one in seen)
        assert is_image(sent.result(SOON), 5, size)
        assert is_image(sent.data(GRIP), 5, size), "of a retained task"
        sent.release()
        with pytest.raises(TaskFailed, match="slipped") as failed:
            user.command(GRIP, image(9, size)).result(SOON)
        assert is_image(failed.value.data_as(SLIPPED), 9, size)
        assert failed.value.data[0] == 9
        until_free(user, 2)  # central remembers how both tasks ended


@SIZES
def test_variable_carries_large_data(running: Central, user: Client, size: int) -> None:
    planner, received = Module("planner", running.address), Received()
    planner.handles(MAP)(received)
    user.set_variable(MAP, image(1, size))
    with planner.running():
        assert is_image(received.next(), 1, size)
        user.set_variable(MAP, image(2, size))
        assert is_image(received.next(), 2, size)
        assert is_image(user.get_variable(MAP), 2, size)
        assert is_image(user.swap_variable(MAP, image(3, size)), 2, size)
        assert is_image(user.get_variable(MAP), 3, size)
    until_free(user, 1)


def test_failure_is_passed_on_with_its_data(running: Central, user: Client) -> None:
    arm, planner = Module("arm", running.address), Module("planner", running.address)
    plan = Command("plan")

    @arm.handles(GRIP)
    def grip(_: Task, found: Image) -> Image:
        raise SLIPPED(found)

    @planner.handles(plan)
    def make_plan(task: Task) -> None:
        task.command(GRIP, image(4, 1 << 20)).result(SOON)

    with arm.running(), planner.running():
        with pytest.raises(TaskFailed) as failed:
            user.command(plan).result(SOON)
        assert is_image(failed.value.data_as(SLIPPED), 4, 1 << 20)
        until_free(user, 1)  # central remembers how the inner task failed


def test_journal_shows_shape_and_not_data(running: Central, user: Client) -> None:
    eyes, received = Module("eyes", running.address), Received()
    eyes.handles(PICTURE)(received)
    with eyes.running():
        user.inform(PICTURE, image(1, 6_000_000).reshape(3, -1))
        received.next()
    sent = [fact for fact in running.facts(facts.Received) if fact.message == PICTURE.name]
    assert plain_data(sent[0].body) == {"dtype": "|u1", "shape": [3, 2_000_000], "bytes": 6_000_000}
    assert (len(sent[0].body) < 200, held_size(sent[0].body) > 6_000_000) == (True, True)
    assert is_large(sent[0].body)


def test_data_survive_a_crash_of_central(tmp_path: Path) -> None:
    received, gate = Received(), threading.Event()

    def wait(_: Task, found: Image) -> Image:
        received(None, found)
        assert gate.wait(SOON)
        return found

    with central(tmp_path) as running:
        eyes = Module("eyes", running.address)
        eyes.handles(GRIP)(wait)
        eyes.handles(ECHO)(lambda _, found: found)
        with eyes.running(), connect("user", running.address) as user:
            sent = [user.command(GRIP, image(value, 1 << 20)) for value in range(3)]
            assert is_image(received.next(), 0, 1 << 20)
            assert all(one.id for one in sent)
            asked = user.query_send(ECHO, image(3, 1 << 20))
            user.status()
            running.kill()
            with central(tmp_path / "other"):
                pass  # it leaves the data of the other run alone
            with central(tmp_path, bind=running.address):
                gate.set()
                assert is_image(asked.receive(SOON), 3, 1 << 20)
                assert all(
                    is_image(one.result(SOON), value, 1 << 20) for value, one in enumerate(sent)
                )
                until_free(user, 3)  # central remembers how the tasks ended
                store = store_of(user)
        assert not (store / "eyes").exists()


def test_lost_memory_loses_no_data_of_tasks(tmp_path: Path) -> None:
    begun, pictures, gate = Received(), Received(), threading.Event()
    with central(tmp_path) as running:
        eyes = Module("eyes", running.address)
        eyes.handles(PICTURE)(pictures)
        eyes.handles(ECHO)(lambda _, found: found)

        @eyes.handles(GRIP)
        def grip(_: Task, found: Image) -> Image:
            begun(None, found)
            assert gate.wait(SOON)
            return found

        with eyes.running(), connect("user", running.address, 60) as user:
            sent = [user.command(GRIP, image(value, 1 << 20)) for value in range(3)]
            begun.next()
            asked = user.query_send(ECHO, image(3, 1 << 20))
            user.inform(PICTURE, image(4, 1 << 20))
            store = store_of(user)
            until_free(user, 5)
            copies = running.journal / "held"
            wait_until(lambda: sum(one.name.isdecimal() for one in copies.glob("*/*/*")) == 3)
            running.kill()
            shutil.rmtree(store)
            with central(tmp_path, bind=running.address) as again:
                gate.set()
                results = [one.result(SOON) for one in sent]
                assert all(is_image(one, value, 1 << 20) for value, one in enumerate(results))
                with pytest.raises(QueryFailed, match=r"bad data.* gone from shared memory"):
                    asked.receive(SOON)
                assert is_image(user.query(ECHO, image(5, 1 << 20)), 5, 1 << 20)
                wait_until(lambda: not copies.exists() or not list(copies.glob("*/*/*")))
        again.stop()
        assert not pictures.images
        assert [one.failure for one in again.facts(facts.Failed)] == ["bad data"] * 2
    assert not store.exists()


def test_data_sent_while_central_is_away_arrive(tmp_path: Path) -> None:
    """A query goes to a new run, whose store is another one."""
    replies: list[Any] = []
    with central(tmp_path) as running:
        eyes = Module("eyes", running.address)
        eyes.handles(ECHO)(lambda _, found: found)
        with eyes.running(), connect("user", running.address, 60) as user:
            user.query(ECHO, image(1, 1 << 20))
            first = store_of(user)
            running.stop()
            asked = user.query_send(ECHO, image(2, 1 << 20))
            with central(tmp_path / "other", bind=running.address):
                replies.append(asked.receive(SOON))
                assert is_image(replies[0], 2, 1 << 20)
                assert store_of(user) != first


def test_messages_while_central_is_away_use_no_memory(tmp_path: Path) -> None:
    with central(tmp_path) as running:
        user = connect("user", running.address, 60)
        user.inform(PICTURE, image(0, 10))  # declares it
        with pytest.raises(Timeout):
            user.query(ECHO, image(0, 10), timeout=0.1)
        store = store_of(user)
        running.kill()
        for value in range(20):
            user.inform(PICTURE, image(value, 1 << 20))
        with pytest.raises(Timeout):
            user.query(ECHO, image(1, 1 << 20), timeout=0.1)
        assert len(list(store.glob("*/*"))) <= 1
        asked = user.query_send(ECHO, image(2, 1 << 20))
        with central(tmp_path, bind=running.address):
            eyes = Module("eyes", running.address)
            eyes.handles(ECHO)(lambda _, found: found)
            with eyes.running():
                assert is_image(asked.receive(SOON), 2, 1 << 20)
            options: dict[str, Any] = {"priority": "high"}
            with pytest.raises(MisuseError):
                user.query(ECHO, image(1, 1 << 20), **options)
            until_free(user)
            with pytest.raises(NotSent):
                user.close()


WATCHER = """
import time
import numpy as np
from numpy.typing import NDArray
from tca_module import Inform, Module

watcher, held = Module("watcher"), []
@watcher.handles(Inform("picture", NDArray[np.uint8]))
def look(_, image):
    held.append(image)
    print(len(held), image[0], flush=True)
watcher.run()
"""


def test_killed_receiver_holds_nothing(running: Central, user: Client) -> None:
    with program(WATCHER, running.address) as watcher:
        user.wait_until_handled(PICTURE, timeout=SOON)
        for value in range(3):
            user.inform(PICTURE, image(value, 1 << 20))
            watcher.hear(f"{value + 1} {value}")
        watcher.kill()
        watcher.communicate()
    until_free(user)
    eyes, received = Module("eyes", running.address), Received()
    eyes.handles(PICTURE)(received)
    with eyes.running():
        user.inform(PICTURE, image(7, 1 << 20))
        assert is_image(received.next(), 7, 1 << 20)


def test_killed_sender_leaves_no_segments(running: Central, user: Client) -> None:
    sender = """
        import os, signal, sys
        import numpy as np
        from numpy.typing import NDArray
        from tca_module import Inform, connect
        user = connect("sender")
        for value in range(5):
            user.inform(Inform("picture", NDArray[np.uint8]), np.full(1 << 20, value, np.uint8))
        user.status()
        os.kill(os.getpid(), signal.SIGKILL)
    """
    eyes, received = Module("eyes", running.address), Received()
    eyes.handles(PICTURE)(received)
    with eyes.running():
        with program(sender, running.address) as killed:
            killed.communicate()
        found = [received.next() for _ in range(5)]
        assert [int(one[-1]) for one in found] == list(range(5))
        wait_until(lambda: {path.name for path in store_of(user).glob("*/*")} <= {"1.free"})


def test_stream_of_images_reuses_few_segments(running: Central, user: Client) -> None:
    eyes, received = Module("eyes", running.address), Received()
    eyes.handles(PICTURE)(received)
    files: set[str] = set()
    with eyes.running():
        for value in range(60):
            user.inform(PICTURE, image(value % 200, 1 << 20))
            received.next()
            files |= {line.split()[4] for line in mapped(store_of(user)) if " rw-s " in line}
    assert len(files) < 10


def test_far_module_gets_the_bytes(running: Central, user: Client) -> None:
    """A module that can't read the key stands for one on another computer."""
    far = """
        import numpy as np
        from numpy.typing import NDArray
        from tca_module import Module, Query
        from tca_module.large import bodies
        bodies.join_pool = lambda *_: (_ for _ in ()).throw(OSError())
        eyes = Module("eyes")
        @eyes.handles(Query("echo", NDArray[np.uint8], reply=NDArray[np.uint8]))
        def echo(_, image):
            assert not image.flags.writeable
            return image + 1 if len(image) < 2 << 20 else np.zeros(9 << 20, np.uint8)
        eyes.run()
    """
    with program(far, running.address) as eyes:
        user.wait_until_handled(ECHO, timeout=SOON)
        assert is_image(user.query(ECHO, image(1, 1 << 20)), 2, 1 << 20)
        until_free(user)
        with pytest.raises(Exception, match="if its module shares no memory with central"):
            user.query(ECHO, image(1, 3 << 20))
        with pytest.raises(Exception, match=r"bad data: .* does not share with central"):
            user.query(ECHO, image(1, 9 << 20))
        eyes.kill()
        eyes.communicate()
