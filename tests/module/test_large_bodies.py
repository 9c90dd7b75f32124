"""The large bodies of a connection: stored in segments, stored again, or sent inline."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from module.large_arrays import ARRAY, RUN, SIZE, array, encoded
from numpy.typing import NDArray

from tca_module import BadData, Client, Failure, Module, Query, Task, TaskFailed
from tca_module.large.bodies import LargeBodies
from tca_module.testing import LocalCentral
from tca_wire.messages.declarations import Command
from tca_wire.messages.large_data import OpenedBody
from tca_wire.packets.headers import PROTOCOL_VERSION, Welcome
from tca_wire.packets.large import unpack_handle
from tca_wire.vocabulary import Limit, Refusal


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
