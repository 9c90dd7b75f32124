"""Segments of large data: written again when free, never while a receiver reads them."""

import fcntl
import gc
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from waiting import wait_until

from tca_module import BadData, Client, Failure, Module, Query, Task, TaskFailed
from tca_module.large import pool as pools
from tca_module.large.bodies import LargeBodies
from tca_module.large.opening import opened
from tca_module.large.pool import IDLE_BYTES, IDLE_SEGMENTS, Pool, join_pool, leave_pool
from tca_module.testing import LocalCentral
from tca_wire.messages.declarations import Command
from tca_wire.messages.formats import Format
from tca_wire.messages.large_data import LargeData, OpenedBody
from tca_wire.packets.headers import PROTOCOL_VERSION, Welcome
from tca_wire.packets.large import LARGE, unpack_handle
from tca_wire.vocabulary import Limit, Refusal

ARRAY: Format[Any] = Format(np.ndarray)
RUN = "ab12"
SIZE = 12 * LARGE
USER = object()


def array(value: int, size: int = SIZE) -> NDArray[np.uint8]:
    return np.full(size, value, np.uint8)


def encoded(value: int, size: int = SIZE) -> LargeData:
    body = ARRAY.encode(array(value, size))
    assert isinstance(body, LargeData)
    return body


class Store:
    """A pool, and central's part in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = str(folder)
        self.pool = Pool(self.folder, RUN)

    @property
    def files(self) -> list[str]:
        return sorted(one.name for one in Path(self.pool.folder).iterdir())

    def send(self, value: int, size: int = SIZE) -> bytes:
        """Store a message, as its sender does; return the body that leaves."""
        return bytes(self.pool.store(encoded(value, size), USER))

    def move(self, body: bytes, before: str, after: str) -> None:
        self.path(body, before).rename(self.path(body, after))

    def path(self, body: bytes, state: str = "") -> Path:
        return Path(self.folder, unpack_handle(body)[0].segment + state)

    def hold(self, body: bytes) -> bytes:
        self.move(body, ".new", "")
        return body

    def free(self, body: bytes) -> None:
        self.move(body, "", ".free")

    def tidy(self) -> None:
        self.pool.tidy()

    def read(self, body: bytes) -> NDArray[np.uint8]:
        found: NDArray[np.uint8] = ARRAY.decode(opened(self.folder, body))
        return found


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    store = Store(tmp_path)
    yield store
    store.pool.close()
    shutil.rmtree(store.folder)
    del store
    assert not maps()


def number(body: bytes) -> int:
    return int(unpack_handle(body)[0].segment.partition("/")[2])


def inode(store: Store, name: str) -> int:
    return Path(store.pool.folder, name).stat().st_ino


def maps(mode: str = "") -> int:
    """Return how many segments of this module's run are mapped here: "r--s" to read, or "rw-s"."""
    gc.collect()
    lines = Path("/proc/self/maps").read_text().splitlines()
    return sum(f"/{RUN}/" in line and f" {mode}" in line for line in lines)


# --- segments -------------------------------------------------------------------------------------


def test_receiver_reads_what_was_sent(store: Store) -> None:
    body = store.hold(store.send(7))
    assert np.array_equal(store.read(body), array(7))
    assert store.files == [str(number(body))]


def test_free_segment_is_written_again_with_a_new_name(store: Store) -> None:
    first = store.hold(store.send(1))
    known = inode(store, str(number(first)))
    store.free(first)
    second = store.send(2)
    assert number(second) > number(first)
    assert store.files == [f"{number(second)}.new"]
    assert inode(store, f"{number(second)}.new") == known
    assert np.array_equal(store.read(store.hold(second)), array(2))


@pytest.mark.parametrize(("size", "is_reused"), [(SIZE // 2, True), (SIZE * 2, False)])
def test_free_segment_is_reused_for_similar_sizes(
    store: Store, size: int, *, is_reused: bool
) -> None:
    first = store.hold(store.send(1))
    store.free(first)
    store.send(2, size)
    assert (f"{number(first)}.free" not in store.files) == is_reused


def test_restored_segment_is_not_written_again(store: Store) -> None:
    body = store.hold(store.send(1))
    content = store.path(body).read_bytes()
    store.path(body).unlink()
    store.path(body).write_bytes(content)  # central has restored it from the disk
    store.free(body)
    assert store.read(store.hold(store.send(2)))[0] == 2
    assert len(store.files) == 1


def test_small_data_leave_a_very_large_segment_alone(store: Store) -> None:
    first = store.hold(store.send(1, 4 << 20))
    store.free(first)
    store.send(2)
    assert f"{number(first)}.free" in store.files


def test_segment_that_is_read_is_not_written_again(store: Store) -> None:
    first = store.hold(store.send(1))
    view = store.read(first)
    store.free(first)
    second = store.hold(store.send(2))
    assert store.files == [str(number(second))], "the first one is removed"
    assert np.array_equal(view, array(1))
    assert np.array_equal(store.read(second), array(2))


def test_segment_is_reused_when_its_last_view_is_gone(store: Store) -> None:
    first = store.hold(store.send(1))
    view = store.read(first)[10:20]
    known = inode(store, str(number(first)))
    store.free(first)
    del view
    assert inode(store, f"{number(store.send(2))}.new") == known


def test_forked_child_keeps_its_view(store: Store) -> None:
    """The lock lasts until the last process has dropped its view."""
    first = store.hold(store.send(1))
    view = store.read(first)
    ended, told = os.pipe()
    if not (child := os.fork()):
        os.close(told)
        os.read(ended, 1)
        os._exit(int(view[-1]))
    os.close(ended)
    del view
    gc.collect()
    known = inode(store, str(number(first)))
    store.free(first)
    assert inode(store, f"{number(store.send(2))}.new") != known
    os.close(told)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1


def test_many_views_need_few_descriptors(store: Store) -> None:
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    views = [store.read(store.hold(store.send(value))) for value in range(150)]
    assert len(list(descriptors.iterdir())) < before + 100
    assert [view[-1] for view in views] == list(range(150))


def test_threads_keep_the_views_that_they_read(store: Store) -> None:
    def read_and_check(_: int) -> bool:
        last: deque[tuple[int, NDArray[np.uint8]]] = deque(maxlen=12)
        for value in range(100):
            body = store.hold(store.send(value))
            last.append((value, store.read(body)))
            store.free(body)
        return all(np.array_equal(view, array(value)) for value, view in last)

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(read_and_check, range(4)))


def test_segment_of_a_living_body_is_not_written_again(store: Store) -> None:
    body = store.pool.store(encoded(1), USER)
    store.hold(body)
    store.free(body)
    store.hold(store.send(2))
    assert f"{number(body)}.free" in store.files, "the body may be sent once more"
    second = number(body)
    del body
    store.send(3)
    assert f"{second}.free" not in store.files


READER = """
import sys, time
import numpy
from tca_module.large.opening import opened
from tca_wire.messages.formats import Format
view = Format(numpy.ndarray).decode(opened(sys.argv[1], bytes.fromhex(sys.argv[2])))
print(view[0], flush=True)
time.sleep(1000)
"""


def test_killed_receiver_no_longer_reads(store: Store) -> None:
    first, second = store.hold(store.send(1)), store.hold(store.send(2))
    for body in (first, second):
        command = [sys.executable, "-c", READER, store.folder, body.hex()]
        reader = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert reader.stdout is not None
        assert reader.stdout.readline() == f"{1 if body is first else 2}\n"
        known = inode(store, str(number(body)))
        store.free(body)
        if body is second:
            reader.send_signal(signal.SIGKILL)
            reader.wait()
        third = store.hold(store.send(3))
        assert (inode(store, str(number(third))) == known) == (body is second)
        reader.kill()
        reader.wait()
        reader.stdout.close()


def test_view_outlives_file_and_body(store: Store) -> None:
    sent = store.hold(store.send(5))
    body = opened(store.folder, sent)
    view = ARRAY.decode(body)[::2]
    store.path(body).unlink()
    del body
    assert maps("r--s") == 1
    assert view[-1] == 5
    del view
    assert maps("r--s") == 0


def test_body_alone_keeps_its_data(store: Store) -> None:
    held = store.send(5)
    body = opened(store.folder, store.hold(held))
    store.free(held)
    store.send(6)
    assert np.array_equal(ARRAY.decode(body), array(5))


def test_late_receiver_reads_a_free_segment(store: Store) -> None:
    body = store.hold(store.send(5))
    store.free(body)
    assert store.read(body)[0] == 5


def test_late_receiver_is_told_that_data_are_gone(store: Store) -> None:
    body = store.hold(store.send(5))
    store.free(body)
    store.send(6)
    late = opened(store.folder, body)
    with pytest.raises(BadData, match="gone from shared memory: their task has ended"):
        ARRAY.decode(late)


def test_receiver_refuses_a_segment_about_to_be_written(store: Store) -> None:
    """Its sender has locked it, and gives it another name in a moment."""
    body = store.hold(store.send(5))
    with store.path(body).open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(BadData, match="gone"):
            store.read(body)
    assert store.read(body)[0] == 5


def test_shortened_segment_is_refused(store: Store) -> None:
    body = store.hold(store.send(5))
    os.truncate(store.path(body), 5000)
    with pytest.raises(BadData, match="has 5000 bytes"):
        store.read(body)


def test_link_in_place_of_a_segment_is_refused(store: Store, tmp_path: Path) -> None:
    body = store.hold(store.send(5))
    path = store.path(body)
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadData, match="can't be read"):
        store.read(body)


# --- the pool -------------------------------------------------------------------------------------


def test_few_free_segments_are_kept(store: Store) -> None:
    bodies = [store.hold(store.send(value)) for value in range(20)]
    for body in bodies:
        store.free(body)
    store.tidy()
    assert len(store.files) == IDLE_SEGMENTS
    assert maps() <= IDLE_SEGMENTS


def test_idle_sender_keeps_no_memory(store: Store) -> None:
    for value in range(3):
        store.free(store.hold(store.send(value)))
    wait_until(lambda: not store.files)


def test_free_segments_are_bounded_in_bytes(store: Store) -> None:
    bodies = [store.hold(store.send(value, IDLE_BYTES // 3)) for value in range(4)]
    for body in bodies:
        store.free(body)
    store.tidy()
    assert 0 < sum(path.stat().st_size for path in Path(store.pool.folder).iterdir()) <= IDLE_BYTES


def test_many_waiting_messages_need_few_descriptors(store: Store) -> None:
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    for value in range(200):
        store.hold(store.send(value, LARGE))
    assert len(list(descriptors.iterdir())) < before + 30
    assert len(store.files) == 200


def test_lost_message_leaves_no_segment(store: Store) -> None:
    other = object()
    kept = store.pool.store(encoded(1), USER)  # a request, which is sent again
    arrived = store.hold(store.send(2))
    lost = store.send(3)
    foreign = store.pool.store(encoded(4), other)
    foreign_name, kept_name = f"{number(foreign)}.new", f"{number(kept)}.new"
    del foreign
    store.pool.take_back(USER)
    assert store.files == sorted([kept_name, str(number(arrived)), foreign_name])
    assert f"{number(lost)}.new" not in store.files


def test_removed_folder_is_made_again(store: Store) -> None:
    body = store.send(1)
    store.path(body, ".new").unlink()
    Path(store.pool.folder).rmdir()
    assert store.read(store.hold(store.send(2)))[0] == 2


def test_end_of_the_module_leaves_only_what_central_holds(store: Store) -> None:
    held, free = store.hold(store.send(1)), store.hold(store.send(2))
    on_its_way = store.send(3)
    store.free(free)
    store.pool.close()
    assert store.files == sorted([str(number(held)), f"{number(on_its_way)}.new"])
    store.path(held).unlink()
    store.path(on_its_way, ".new").unlink()
    store.pool.close()
    assert not Path(store.pool.folder).exists()


def test_threads_share_a_pool(store: Store) -> None:
    wrong: list[int] = []

    def send_many(value: int) -> None:
        for _ in range(50):
            body = store.hold(store.send(value))
            if not np.array_equal(store.read(body), array(value)):
                wrong.append(value)
            store.free(body)

    threads = [threading.Thread(target=send_many, args=(value,)) for value in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    store.tidy()
    assert len(store.files) <= IDLE_SEGMENTS


def in_child(store: Store, results: Any) -> None:
    results.put(len(pools._pools))
    store.pool.close()
    gc.collect()


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_forked_child_leaves_the_pool_alone(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.pool = pool = join_pool(str(tmp_path), RUN)
    body = store.hold(store.send(1))
    store.free(body)
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    child = context.Process(target=in_child, args=(store, results))
    child.start()
    assert results.get() == 0
    child.join()
    assert store.files == [f"{number(body)}.free"]
    leave_pool(pool)
    assert not Path(pool.folder).exists()


def test_connections_of_one_run_share_a_pool(tmp_path: Path) -> None:
    first, second = join_pool(str(tmp_path), RUN), join_pool(str(tmp_path), RUN)
    assert first is second
    leave_pool(first)
    assert Path(first.folder).exists()
    leave_pool(second)
    assert not Path(first.folder).exists()


# --- connections ----------------------------------------------------------------------------------


def welcome(store: Path | str, epoch: str = "one") -> Welcome:
    return Welcome(1, PROTOCOL_VERSION, "eyes", epoch, str(store))


def make_store(folder: Path, epoch: str = "one") -> Path:
    folder.mkdir()
    (folder / "key").write_text(epoch)
    return folder


@pytest.mark.parametrize("case", ["none", "missing", "other", "unreadable"])
def test_memory_is_shared_only_if_the_key_is_there(tmp_path: Path, case: str) -> None:
    folders: dict[str, Path | str] = {
        "none": "",
        "missing": tmp_path,
        "other": make_store(tmp_path / "other", "another run"),
        "unreadable": make_store(tmp_path / "file") / "key",
    }
    bodies, folder = LargeBodies(), folders[case]
    assert not bodies.on_welcome(welcome(folder), RUN)
    body = bodies.store(encoded(5), "'image'")
    handle, rest = unpack_handle(body)
    assert (handle.segment, len(rest)) == ("", SIZE)
    assert ARRAY.decode(body)[0] == 5
    too_large = np.zeros(Limit.BODY, np.uint8)
    with pytest.raises(BadData, match=r"'image' has .* if its module shares no memory"):
        bodies.store(ARRAY.encode(too_large), "'image'")


def test_body_is_stored_once_while_central_is_the_same(tmp_path: Path) -> None:
    folder = make_store(tmp_path / "store")
    bodies = LargeBodies()
    assert bodies.on_welcome(welcome(folder), RUN)
    body = bodies.store(encoded(5), "'image'")
    assert bodies.on_welcome(welcome(folder), RUN)
    assert bodies.restore(body) is body
    bodies.close()


def test_body_is_stored_again_for_another_central(tmp_path: Path) -> None:
    first, second = make_store(tmp_path / "1"), make_store(tmp_path / "2", "two")
    bodies = LargeBodies()
    bodies.on_welcome(welcome(first), RUN)
    body = bodies.store(encoded(5), "'image'")
    bodies.on_welcome(welcome(second, "two"), RUN)
    again = bodies.restore(body)
    assert isinstance(again, OpenedBody)
    assert Path(f"{second}/{unpack_handle(again)[0].segment}.new").exists()
    bodies.on_welcome(welcome("", "three"), RUN)  # without shared memory
    alone = bodies.restore(again)
    assert unpack_handle(alone)[0].segment == ""
    assert ARRAY.decode(alone)[0] == 5


def test_lost_segment_is_stored_again(tmp_path: Path) -> None:
    """Central removes the segments of a module that was stopped for long."""
    folder, bodies = make_store(tmp_path / "store"), LargeBodies()
    bodies.on_welcome(welcome(folder), RUN)
    body = bodies.store(encoded(5), "'image'")
    path = Path(folder, unpack_handle(body)[0].segment)
    for state in ("", ".free"):
        Path(f"{path}.new").rename(f"{path}{state}")
        assert bodies.restore(body) is body
        Path(f"{path}{state}").rename(f"{path}.new")
    shutil.rmtree(path.parent)
    again = bodies.restore(body)
    path = Path(folder, unpack_handle(again)[0].segment + ".new")
    assert path.read_bytes()[:SIZE] == array(5).tobytes()
    bodies.close()


def test_received_data_are_passed_on_in_an_own_segment(tmp_path: Path) -> None:
    folder = make_store(tmp_path / "store")
    sender, receiver = LargeBodies(), LargeBodies()
    sender.on_welcome(welcome(folder), "aa")
    receiver.on_welcome(welcome(folder), "bb")
    sent = sender.store(encoded(5), "'image'")
    path = Path(folder, unpack_handle(sent)[0].segment)
    Path(f"{path}.new").rename(path)
    got = receiver.opened(bytes(sent))
    passed = receiver.store(got, "'image'")
    assert unpack_handle(passed)[0].segment.startswith("bb/")
    sender.close()
    receiver.close()


FILL = """
import sys
import numpy
from tca_module.errors import Refused
from tca_module.large.bodies import LargeBodies
from tca_wire.messages.formats import Format
from tca_wire.messages.large_data import detached
from tca_wire.packets.headers import Welcome
from tca_wire.packets.large import unpack_handle
open(sys.argv[1] + "/key", "w").write("one")
bodies = LargeBodies()
image = Format(numpy.ndarray).encode(numpy.ones(900_000, numpy.uint8))
waiting = detached(image)
assert bodies.on_welcome(Welcome(1, 1, "eyes", "one", sys.argv[1]), "ab")
held = bodies.store(image, "'image'")
try:
    bodies.store(image, "'image'")
except Refused as error:
    print(error.refusal, error)
alone = bodies.restore(waiting)
assert (unpack_handle(alone)[0].segment, len(alone) > 900_000) == ("", True)
del held
"""


def test_full_memory_refuses_a_message_as_overload(tmp_path: Path) -> None:
    command = f"mount -t tmpfs -o size=1m none {tmp_path} && exec {sys.executable} - {tmp_path}"
    unshared = ["unshare", "--mount", "--user", "--map-root-user", "sh", "-c", command]
    done = subprocess.run(unshared, input=FILL, capture_output=True, text=True, check=False)
    if "unshare" in done.stderr:
        pytest.skip(f"no user namespaces here: {done.stderr}")
    assert done.stderr == ""
    assert done.stdout.startswith(f"{Refusal.OVERLOAD} 'image' was refused: shared memory is full")
    assert "900,000 bytes are needed" in done.stdout


# --- modules --------------------------------------------------------------------------------------

LOOK = Query("look", int, reply=NDArray[np.uint8])
MEAN = Query("mean", NDArray[np.uint8], reply=float)
BLURRED = Failure("blurred", NDArray[np.uint8])
FOCUS = Command("focus", NDArray[np.uint8], result=NDArray[np.uint8], progress=NDArray[np.uint8])


def test_central_in_the_process_carries_large_data(
    central: LocalCentral, eyes: Module, user: Client
) -> None:
    @eyes.handles(LOOK)
    def look(_: Task, size: int) -> NDArray[np.uint8]:
        return array(3, size)

    @eyes.handles(MEAN)
    def mean(_: Task, image: NDArray[np.uint8]) -> float:
        assert not image.flags.writeable
        return float(image.mean())

    @eyes.handles(FOCUS)
    def focus(task: Task, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        changing = image.copy()
        for value in (1, 2):
            changing[:] = value
            task.report(changing)
        if image[0]:
            raise BLURRED(changing)
        return changing

    with eyes.running():
        image = user.query(LOOK, 1 << 20)
        assert not image.flags.writeable
        assert user.query(MEAN, image) == 3
        focused = user.command(FOCUS, array(0), suspended=True)
        progress = focused.progress()
        focused.resume()
        assert [int(one.mean()) for one in progress] == [1, 2]
        assert np.array_equal(focused.result(5), array(2))
        with pytest.raises(TaskFailed, match="blurred") as failed:
            user.command(FOCUS, array(1)).result(5)
        assert np.array_equal(failed.value.data_as(BLURRED), array(2))
        with pytest.raises(BadData, match=r"'mean' has .* at most"):
            user.query(MEAN, np.zeros(Limit.BODY, np.uint8))
    assert f"uint8 array of {1 << 20} (1 MiB)" in central.transcript()
