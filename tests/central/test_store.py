"""The store of large data: the names of its files say which segments central needs."""

import gc
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from central.shared_store import DATA, MODULE, Shared, handle

from tca_central.core import Central
from tca_central.events import Arrived, ConnectionId
from tca_central.image.decoder import decode
from tca_central.image.encoder import encode
from tca_central.inputs import events_of
from tca_central.model.observers import encode_change
from tca_central.shell import store
from tca_central.shell.large_bodies import LargeBodies
from tca_central.shell.outboxes import Outboxes
from tca_central.shell.store import Store, StoredBody
from tca_module.large.pool import Pool
from tca_wire.packets import codec
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Answer,
    Hello,
    Register,
    Reply,
    Send,
    SetVariable,
    ToModule,
    Welcome,
)
from tca_wire.packets.large import Handle, held_size, pack_handle, unpack_handle
from tca_wire.packets.parts import HandlerFormat, MessageFormat, StateChange
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Party

LINE = ConnectionId(b"line")


@pytest.fixture
def shared(tmp_path: Path) -> Iterator[Shared]:
    one = Shared(tmp_path)
    yield one
    one.close()


# --- the states of a segment ------------------------------------------------------------------------


def test_segment_is_held_until_its_last_body_ends(shared: Shared) -> None:
    body = shared.write("a1/7")
    assert shared.files() == ["a1/7.new"]
    first, second = shared.store.adopt(body), shared.store.adopt(body)
    assert shared.files() == ["a1/7"]
    assert (first, shared.store.held_bytes) == (body, len(DATA))
    del first
    assert shared.files() == ["a1/7"]
    del second
    assert shared.files() == ["a1/7.free"]
    assert shared.store.held_bytes == 0


def test_released_segment_is_removed_when_its_module_left(shared: Shared) -> None:
    held, free = shared.store.adopt(shared.write("a1/1")), shared.store.adopt(shared.write("a1/2"))
    shared.write("a1/3")
    del free
    assert shared.files() == ["a1/1", "a1/2.free", "a1/3.new"]
    shared.modules.clear()
    shared.store.sweep(shared.modules)
    assert shared.files() == ["a1/1"]
    del held
    assert shared.files() == []
    shared.store.sweep(shared.modules)
    assert not (shared.folder / "a1").exists()


def test_missing_segment_is_passed_on(shared: Shared) -> None:
    body = shared.store.adopt(handle("a1/404"))
    assert isinstance(body, StoredBody)
    del body
    assert shared.files() == []


def test_damaged_handle_is_no_stored_body(shared: Shared) -> None:
    for damaged in (b"\xc1", b"\xc1abc", handle("a1/../x"), handle("a1/1", 1 << 40)):
        assert shared.store.adopt(damaged) is damaged


def test_end_of_a_body_never_raises(shared: Shared) -> None:
    body = shared.store.adopt(shared.write("a1/1"))
    shared.close()
    del body
    shared.store.settle(set())


def test_store_goes_on_when_its_folder_was_removed(shared: Shared) -> None:
    """Some systems remove a user's files in /dev/shm when the user logs out."""
    bodies = [shared.store.adopt(shared.write("a1/1"))]
    shutil.rmtree(shared.folder)
    bodies.append(shared.store.adopt(handle("a1/2")))
    with pytest.raises(OSError, match="No such file"):
        shared.store.write(Handle("", 3, 0, b""), memoryview(b"abc"))
    with pytest.raises(OSError, match="No such file"):
        shared.store.read(Handle("a1/1", 3, 0, b""))
    shared.store.add_module("b2")
    bodies.clear()
    shared.store.settle(shared.modules)
    shared.store.sweep(set())
    assert shared.store.held_bytes == 0


# --- folders of runs --------------------------------------------------------------------------------


def test_folder_is_private_and_names_its_run(shared: Shared) -> None:
    assert shared.folder.name == f"tca-{os.getuid()}-run"
    assert shared.folder.stat().st_mode & 0o777 == 0o700
    assert (shared.folder / "key").read_text() == "run"


def test_central_removes_folders_of_dead_centrals(tmp_path: Path) -> None:
    dead, living = Shared(tmp_path, "dead"), Shared(tmp_path, "living")
    dead.write("a1/1")
    dead.close()
    other_users = tmp_path / f"tca-{os.getuid() + 1}-dead"
    other_users.mkdir()
    own = Shared(tmp_path)
    own.sweep()
    assert not dead.folder.exists()
    assert living.folder.exists()
    assert own.folder.exists()
    assert other_users.exists()
    for one in (living, own):
        one.close()


def test_folder_of_a_dead_central_stays_for_its_modules(tmp_path: Path) -> None:
    dead = Shared(tmp_path, "dead")
    module = Pool(str(dead.folder), "b1")
    dead.close()
    own = Shared(tmp_path)
    own.sweep()
    assert dead.folder.exists()
    module.close()
    own.sweep()
    assert not dead.folder.exists()
    own.close()


def test_folder_goes_with_the_end_of_its_run(shared: Shared) -> None:
    shared.write("a1/1")
    shared.store.close(is_over=True)
    assert not shared.folder.exists()


@pytest.mark.parametrize("kind", ["missing", "file", "open to others"])
def test_no_store_without_a_usable_folder(tmp_path: Path, kind: str) -> None:
    root = tmp_path / "shm"
    if kind != "missing":
        root.mkdir()
        folder = root / f"tca-{os.getuid()}-run"
        folder.write_bytes(b"") if kind == "file" else folder.mkdir(mode=0o755)
    unusable = Store(root)
    unusable.open("run")
    assert unusable.folder is None
    body = unusable.adopt(handle("a1/1"))
    del body
    unusable.settle(set())
    unusable.sweep(set())
    unusable.close(is_over=True)


# --- a restart --------------------------------------------------------------------------------------


def packet(*items: tuple[object, bytes]) -> bytes:
    return codec.pack(items)  # type: ignore[arg-type]


class Run:
    """A core whose inputs are replayed by later ones."""

    def __init__(self, shared: Shared) -> None:
        self.central = Central("run")
        self.adopt = shared.store.adopt
        self.packets: list[bytes] = []

    def receive(self, *items: tuple[object, bytes]) -> None:
        self.handle(packet(*items))

    def handle(self, one: bytes) -> None:
        self.packets.append(one)
        for event in events_of(Arrived(0.0, LINE, one), adopt=self.adopt):
            self.central.handle(event)

    def join(self) -> None:
        declared = MessageFormat("picture", MessageClass.INFORM, "{}")
        variable = MessageFormat("map", MessageClass.VARIABLE, "{}")
        self.receive((Hello(1, PROTOCOL_VERSION, "eyes", MODULE, resource="eyes"), b""))
        register = Register(2, [declared, variable], [HandlerFormat("picture", "eyes")])
        self.receive((register, b""))


def test_replay_and_image_hold_the_same_segments(tmp_path: Path) -> None:
    first = Shared(tmp_path)
    run = Run(first)
    run.join()
    run.receive((Send(3, "picture"), first.write("a1/1")))
    run.receive((SetVariable(4, "map"), first.write("a1/2")))
    run.receive((Send(5, "picture"), first.write("a1/3")))
    first.write("a1/4")
    deliveries = [one.id for one in run.central.dispatcher.running.values()]
    run.receive((Reply(deliveries[0]), b"\xc0"))
    assert first.files() == ["a1/1.free", "a1/2", "a1/3", "a1/4.new"]
    image, packets = encode(run.central), run.packets
    first.close()
    for is_image in (True, False):
        again = Store(tmp_path)
        if is_image:
            central = decode(image, again.adopt)
            assert encode(central) == image
        else:
            replayed = Run(first)
            replayed.adopt = again.adopt
            for one in packets:
                replayed.handle(one)
            central = replayed.central
            del replayed
        again.open("run")
        gc.collect()
        again.settle({MODULE})
        assert again.held_bytes == 2 * len(DATA)
        assert central.variables.bytes == held_size(handle("a1/2"))
        again.close(is_over=False)


def test_segments_that_no_state_needs_are_released_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Shared(tmp_path)
    bodies = [first.store.adopt(first.write(f"a1/{number}")) for number in (1, 2, 3)]
    own = first.store.adopt(first.store.write(Handle("", 3, 0, b""), memoryview(b"abc")))
    first.close()
    monkeypatch.setattr(store, "ORPHANED", 0.0)
    second = Store(tmp_path)
    kept = second.adopt(handle("a1/1"))
    second.open("run")
    repeated = second.adopt(handle("a1/2"))
    second.sweep({MODULE})
    left = sorted(path.name for path in (first.folder / "a1").iterdir())
    assert left == ["1", "2", "3.free"]
    assert list((first.folder / "0").iterdir()) == []
    second.close(is_over=True)
    del bodies, own, kept, repeated


# --- without shared memory --------------------------------------------------------------------------


@pytest.fixture
def border(shared: Shared) -> LargeBodies:
    run = Run(shared)
    run.join()
    return LargeBodies(run.central, shared.store, Outboxes(lambda *_: False))


def outgoing(border: LargeBodies, header: ToModule, body: bytes = b"") -> tuple[ToModule, bytes]:
    """Return the next message that leaves central."""
    packets = list[bytes]()

    def send(_: ConnectionId, packet: bytes) -> bool:
        packets.append(packet)
        return True

    border._outboxes._send = send
    border.enqueue(LINE, header, body)
    border._outboxes.send_all()
    (item,) = codec.unpack_to_module(packets[0])
    return item


def inline(data: bytes = DATA) -> bytes:
    return pack_handle(Handle("", len(data), 0, b"\xc0")) + data


def test_inline_bytes_move_to_a_segment_and_back(shared: Shared, border: LargeBodies) -> None:
    ordinary = Send(4, "picture"), b"\xc0"
    moved = border.with_segments(packet((Send(3, "picture"), inline()), ordinary))
    (header, body), second = codec.unpack_to_central(moved)
    assert (header, second) == (Send(3, "picture"), ordinary)
    name = unpack_handle(body)[0].segment
    assert shared.files() == [f"{name}.new"]
    stored = shared.store.adopt(body)
    assert (shared.folder / name).read_bytes() == DATA
    assert outgoing(border, Answer(1), stored) == (Answer(1), inline())
    del stored
    assert shared.files() == []


def test_other_packets_stay_as_they_are(border: LargeBodies) -> None:
    for same in (b"no packet", packet((Send(3, "picture"), bytes(1 << 20)))):
        assert border.with_segments(same) is same


def test_bytes_stay_inline_in_a_full_memory(
    border: LargeBodies, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(border.store, "folder", Path("/dev/full/missing"))
    same = packet((Send(3, "picture"), inline()))
    assert border.with_segments(same) is same


def test_handle_stays_where_its_bytes_can_not_be_sent(shared: Shared, border: LargeBodies) -> None:
    too_large = shared.store.adopt(shared.write("a1/1", bytes(8 << 20)))
    missing = shared.store.adopt(handle("a1/2"))
    for body in (too_large, missing):
        assert outgoing(border, Answer(1), body) == (Answer(1), body)


def test_welcome_names_the_folder(shared: Shared, border: LargeBodies) -> None:
    welcome = Welcome(1, PROTOCOL_VERSION, "eyes", "run")
    header, _ = outgoing(border, welcome)
    assert isinstance(header, Welcome)
    assert header.store == str(shared.folder)


def test_answers_hold_their_segments_until_they_are_read(
    shared: Shared, border: LargeBodies
) -> None:
    border.note_sharing(LINE)
    sizes: list[int] = []
    for number in (1, 2, 3):
        body = shared.store.adopt(shared.write(f"a1/{number}"))
        assert outgoing(border, Answer(1), body) == (Answer(1), handle(f"a1/{number}"))
        sizes.append(border._outboxes.ahead(LINE) - sum(sizes))
        del body
    assert shared.files() == ["a1/1", "a1/2", "a1/3"]
    border.credit(LINE, sizes[0] + sizes[1] - 1)
    assert shared.files() == ["a1/1.free", "a1/2", "a1/3"]
    border.credit(LINE, 1)
    assert shared.files() == ["a1/1.free", "a1/2.free", "a1/3"]
    del border._central.registry.connections[LINE]
    border.sweep()
    assert shared.files() == ["a1/1.free", "a1/2.free", "a1/3.free"]


def test_slow_reader_holds_a_limited_number_of_segments(
    shared: Shared, border: LargeBodies
) -> None:
    border.note_sharing(LINE)
    border._central.budget.unread = 5 * len(DATA) // 2
    for number in (1, 2, 3):
        body = shared.store.adopt(shared.write(f"a1/{number}"))
        border.enqueue(LINE, Answer(1, more=True), body)
        del body
    assert shared.files() == ["a1/1.free", "a1/2", "a1/3"]


def test_report_of_a_state_holds_its_segments(shared: Shared, border: LargeBodies) -> None:
    goal = shared.store.adopt(shared.write("a1/1"))
    change = StateChange(TaskId(3), "grasp", 1, "running", "begin", Party.SERVER, goal=goal)
    encoded = encode_change(change)
    del goal, change
    inline_change = msgspec.msgpack.decode(
        outgoing(border, Answer(1), encoded)[1], type=StateChange
    )
    assert inline_change.goal == inline()
    border.note_sharing(LINE)
    border.enqueue(LINE, Answer(1, more=True), encoded)
    del encoded
    assert shared.files() == ["a1/1"]
    border.credit(LINE, 1 << 20)
    assert shared.files() == ["a1/1.free"]
