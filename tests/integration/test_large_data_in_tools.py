"""The tools on a run with large data, of which the journal's folder keeps some."""

import base64
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from numpy.typing import NDArray
from processes import central, run

from tca_module import Command, Goal, Inform, Module, Query, Task, Variable, connect
from tca_module.testing import LocalCentral
from tca_tools.command_line import main
from tca_wire.packets.large import DATA_FOLDER

pytestmark = pytest.mark.slow

SOON = 20.0
Image = NDArray[np.uint8]


@dataclass
class Shot:
    """An image with a few words."""

    camera: str
    image: Image
    depth: NDArray[np.float32]


PICTURE = Inform("picture", Image, journal=True)
SHOT = Query("shot", str, reply=Shot, journal=True)
LOOK = Goal("look", Image, progress=Image, journal=True)
GRIP = Command("grip", Image, result=Image)
TEXT = Inform("text", list[int], journal=True)
MAP = Variable("map", Image)

GREY = np.resize(np.arange(251, dtype=np.uint8), (300, 400))
COLOURS = np.resize(GREY, (240, 320, 3))
CLEAR = np.resize(GREY, (160, 150, 4))
DEPTH = np.zeros((200, 200), np.float32)
NUMBERS = [*range(40_000)]
ARRAYS = {
    "/images/messages/picture": GREY,
    "/images/results/shot/image": COLOURS,
    "/images/messages/look": CLEAR,
    "/images/progress/look": GREY,
}


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the journal of a run with messages of several classes."""
    with central(tmp_path_factory.mktemp("run")) as running:
        eyes = Module("eyes", running.address)
        eyes.handles(PICTURE)(lambda _, _image: None)
        eyes.handles(TEXT)(lambda _, _numbers: None)
        eyes.handles(SHOT)(lambda _, camera: Shot(camera, COLOURS, DEPTH))
        eyes.handles(GRIP)(lambda _, image: image)

        @eyes.handles(LOOK)
        def look(task: Task, _: Image) -> None:
            task.report(GREY)

        with eyes.running(), connect("user", running.address) as user:
            user.inform(PICTURE, GREY)
            user.inform(TEXT, NUMBERS)
            user.query(SHOT, "left", timeout=SOON)
            user.set_variable(MAP, GREY)
            user.command(GRIP, COLOURS).result(SOON)
            user.goal(LOOK, CLEAR).wait(SOON)
            shown = [
                run("tca", *words, "--central", running.address).stdout
                for words in (["variables"], ["get", "map"], ["get", "map", "--json"])
            ]
        running.stop()
        assert '"uint8 array of 300 x 400 (117 KiB)"' in shown[0]
        assert shown[1] == "uint8 array of 300 x 400 (117 KiB)\n"
        assert json.loads(shown[2]) == {"dtype": "|u1", "shape": [300, 400], "bytes": 120_000}
        yield running.journal


@pytest.fixture(params=["kept", "removed"])
def either(journal: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Return a journal with the kept data, or without."""
    copy = tmp_path / "journal"
    shutil.copytree(journal, copy)
    if request.param == "removed":
        shutil.rmtree(copy / DATA_FOLDER)
    return copy


def tca(*arguments: object) -> str:
    runner = CliRunner(env={"COLUMNS": "200"})
    done = runner.invoke(main, [str(one) for one in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def exported(journal: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the messages of the topics in the run as MCAP."""
    file = journal.with_suffix(".mcap")
    tca("export", journal, "-o", file)
    topics: dict[str, list[dict[str, Any]]] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert channel.topic.startswith("/images") == (schema.name == "foxglove.RawImage")
            topics.setdefault(channel.topic, []).append(json.loads(message.data))
    return topics


def test_mcap_has_the_pixels_of_images(journal: Path) -> None:
    topics = exported(journal)
    found = {name: topic for name, topic in topics.items() if name.startswith("/images")}
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        (image,) = found[name]
        pixels = np.frombuffer(base64.b64decode(image["data"]), np.uint8)
        assert np.array_equal(pixels.reshape(array.shape), array)
        assert (image["height"], image["width"]) == array.shape[:2]
        channels = array.shape[2] if array.ndim == 3 else 1
        assert image["step"] == array.shape[1] * channels
        assert image["encoding"] == {1: "mono8", 3: "rgb8", 4: "rgba8"}[channels]
        assert image["timestamp"]["sec"] > 1_000_000_000
    assert topics["/messages/text"][0]["data"] == NUMBERS
    shot = topics["/results/shot"][0]["data"]
    assert shot["depth"] == {"dtype": "<f4", "shape": [200, 200], "bytes": 160_000}


def test_mcap_describes_images_that_were_not_kept(journal: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(journal, tmp_path / "journal")
    shutil.rmtree(copy / DATA_FOLDER)
    topics = exported(copy)
    assert not [name for name in topics if name.startswith("/images")]
    described = {"dtype": "|u1", "shape": [300, 400], "bytes": 120_000}
    assert topics["/messages/picture"][0]["data"] == described


@pytest.mark.parametrize(
    "command",
    [
        "log show",
        "log show --classic",
        "log show --json",
        "tree",
        "tree --story 1",
        "gantt",
        "stats",
        "stats --json",
        "check",
        "check --rerun",
        "replay --text",
        "report -o out.html",
        "gantt -o out.svg",
        "export -o out.jsonl",
        "export -o out.pftrace",
        "export --to csv -o csv",
        "export --to parquet -o parquet",
    ],
)
def test_tool_reads_a_run_with_large_data(
    either: Path, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first, _, options = command.partition(" -")
    tca(*first.split()[:2], *first.split()[2:], either, *(f"-{options}".split() if options else ()))


def test_log_shows_arrays_in_words(journal: Path) -> None:
    shown = tca("log", "show", journal)
    assert '"uint8 array of 300 x 400 (117 KiB)"' in shown
    assert '{"camera": "left", "image": "uint8 array of 240 x 320 x 3 (225 KiB)", ' in shown
    assert '"data of ' in shown


def test_run_of_a_local_central_has_its_images(tmp_path: Path) -> None:
    with LocalCentral() as local:
        eyes = Module("eyes", local)
        eyes.handles(SHOT)(lambda _, camera: Shot(camera, COLOURS, DEPTH))
        eyes.handles(GRIP)(lambda _, image: image)
        with eyes.running(), connect("user", local) as user:
            user.query(SHOT, "left", timeout=SOON)
            user.command(GRIP, COLOURS[:4, :5]).result(SOON)
        journal = tmp_path / "run.tcaj"
        local.save(journal)
    topics = exported(journal)
    images = ["/images/messages/grip", "/images/results/grip", "/images/results/shot/image"]
    assert sorted(name for name in topics if name.startswith("/images")) == images
    for name, array in zip(images, (COLOURS[:4, :5], COLOURS[:4, :5], COLOURS), strict=True):
        assert base64.b64decode(topics[name][0]["data"]) == array.tobytes()
    assert '"uint8 array of 4 x 5 x 3 (60 bytes)"' in tca("log", "show", journal)
    tca("check", journal)
    tca("replay", "--text", journal)
