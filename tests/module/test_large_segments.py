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
from module.large_arrays import ARRAY, RUN, SIZE, array, encoded
from numpy.typing import NDArray
from waiting import wait_until

from tca_module import BadData
from tca_module.large import pool as pools
from tca_module.large.opening import opened
from tca_module.large.pool import IDLE_BYTES, IDLE_SEGMENTS, Pool, join_pool, leave_pool
from tca_wire.packets.large import LARGE, unpack_handle

USER = object()


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
