"""Images: the state of central as bytes. A central that is read from an image behaves like the
central that wrote the image.
"""

import os
import random
import subprocess
import sys
from collections import OrderedDict, deque
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from central import separate_life
from central.player import IN_PYTHON, Player
from central.transcript import Transcript
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation
from properties.life_of_states import LifeOfStates

from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.events import ConnectionId, Effect
from tca_central.image import container
from tca_central.image.decoder import decode
from tca_central.image.encoder import can_encode, encode
from tca_central.image.shapes import shape_named, shape_of
from tca_central.model.stored import Stored
from tca_central.model.tasks import Verdict
from tca_wire.constraints import Flags
from tca_wire.packets.headers import Accepted
from tca_wire.points import Moment, Point, TaskId
from tca_wire.rules import NO_GOAL
from tca_wire.vocabulary import Due, MessageClass, Outcome, Role

TRANSCRIPTS = sorted(Path(__file__).parent.glob("transcripts/*.txt"))


class TwinPlayer(Player):
    """A player that gives each event to a second central, too, and compares the effects. After
    every few events, the second central is read from a new image.
    """

    every = 9
    """The number of events between two images."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.twin = decode(encode(self.central))
        self.events = self.images = 0

    def event(self, event: Any) -> list[Effect]:
        effects = super().event(event)
        assert msgspec.msgpack.encode(self.twin.handle(event)) == msgspec.msgpack.encode(effects)
        self.events += 1
        if self.events % self.every == 0 and can_encode(self.central):
            image = encode(self.central)
            assert image == encode(self.central)
            self.twin = decode(image)
            self.images += 1
            check_invariants(self.twin)
        return effects


class QuickTwinPlayer(TwinPlayer):
    """A twin player whose slots prefetch messages."""

    prefetch = 8

    def __init__(self) -> None:
        super().__init__()
        self.central.dispatcher.prefetcher.trusts_all = True
        self.twin = decode(encode(self.central))


@given(st.lists(operation, max_size=60), st.sampled_from([TwinPlayer, QuickTwinPlayer]))
@settings(max_examples=20)
def test_central_from_image_behaves_like_the_original(
    operations: list[tuple[str, int, int, int, int]], player: type[TwinPlayer]
) -> None:
    life = Life(player())
    for name, *numbers in operations:
        life.do(name, *numbers)


@pytest.mark.parametrize("every", [40, pytest.param(7, marks=pytest.mark.soak)])
def test_central_from_image_behaves_alike_over_long_lives(every: int) -> None:
    player = TwinPlayer()
    player.every = every
    Life(player).go_on(seed=every, events=800)
    assert player.images > 2


def test_central_from_image_behaves_alike_with_state_changes() -> None:
    player = TwinPlayer()
    player.every = 25
    LifeOfStates(player).go_on(seed=3, events=400)
    assert player.images > 8


@pytest.mark.parametrize("player", [TwinPlayer, QuickTwinPlayer])
def test_old_image_behaves_like_a_recent_one(player: type[TwinPlayer]) -> None:
    life = Life(player())
    life.go_on(seed=5, events=100)
    life.player.every = 1 << 30  # type: ignore[attr-defined]
    life.go_on(seed=6, events=300)


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.soak] if number % 8 else [])
        for number, path in enumerate(TRANSCRIPTS)
    ],
    ids=lambda path: path.stem,
)
def test_transcript_continues_identically_from_images(path: Path) -> None:
    transcript = Transcript()
    transcript.player = TwinPlayer()
    for block in path.read_text().strip().split("\n\n")[1:]:
        for command in block.split("\n----")[0].splitlines():
            transcript.play(command)


@pytest.mark.soak
def test_image_does_not_depend_on_hash_order(tmp_path: Path) -> None:
    """Processes with different hash seeds write the same bytes. They also continue alike from the
    image of another process.
    """
    seed, image = 7, tmp_path / "image"
    # Folders under pytest's temporary one hold files of other tests.
    paths = os.pathsep.join(path for path in sys.path if "pytest-of-" not in path)
    own_image, effects = separate_life.live(seed, None)
    image.write_bytes(own_image)
    for number in (1, 2):
        command = [sys.executable, separate_life.__file__, str(seed), str(image)]
        environment = {**os.environ, "PYTHONHASHSEED": str(number), "PYTHONPATH": paths}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.stdout.split() == [separate_life.digest(own_image), effects], done.stderr


def test_image_of_decoded_image_is_identical() -> None:
    life = Life()
    life.go_on(seed=3, events=200)
    image = encode(life.central)
    assert encode(decode(image)) == image


def deep(number: int) -> Central:
    """Return a central with a chain of *number* tasks."""
    player = Player.of("planner: goal walk", "user", check=False)
    parent = 0
    for _ in range(number):
        parent = player.task("user", "walk", under=parent, flags=Flags.NONE)
    return player.central


def test_deep_tree_is_encoded_without_recursion() -> None:
    central = deep(3000)
    before = sum(task.has_parts for task in central.tree.tasks.values())
    again = decode(encode(central))
    assert before == sum(task.has_parts for task in central.tree.tasks.values())
    tasks = list(again.tree.tasks.values())
    assert len(tasks) == 3000
    assert all(below.parent is above for above, below in pairwise(tasks))


def test_shared_objects_stay_shared_after_decoding() -> None:
    life = Life()
    life.go_on(seed=1, events=150)
    central = decode(encode(life.central))
    assert (
        central.facts
        is central.agenda._facts
        is central.agenda.holds._facts
        is central.dispatcher._facts
    )
    assert central.dispatcher._suspects is central.suspects
    assert central.dispatcher._out is central
    assert central.tree is central.agenda.tree
    for connection in central.registry.connections.values():
        assert connection.module.connections[connection.session] is connection


def test_repeated_data_is_stored_once() -> None:
    player = Player.of("user", "a: broadcast pose", "b: broadcast pose", "c: broadcast pose")
    size = len(encode(player.central))
    player.central.variables.values = dict.fromkeys(("x", "y", "z"), b"." * 100_000)  # type: ignore[arg-type]
    assert len(encode(player.central)) < size + 101_000


def test_every_value_type_survives_encoding() -> None:
    central = Player.of("user").central
    values: list[Any] = [
        Verdict("gone", "user"),
        Point(TaskId(3), Moment.END_PLANNING),
        NO_GOAL,
        Accepted(1, TaskId(2)),
    ]
    values += [*Role, *Outcome, *Due, *MessageClass, Flags(3)]
    values += [tuple(range(length)) for length in range(12)] + [(1, ("a", ("b",)))]
    values += [
        None,
        True,
        1,
        1.0,
        0.0,
        -0.0,
        float("inf"),
        1 << 200,
        -1 << 70,
        "1",
        b"1",
        "é" * 300,
        b"\0" * 300,
    ]
    values += [[], [1, [2]], {}, {1: {"a": ()}}, deque([1, None]), OrderedDict(b=1, a=2)]
    central.facts.extend(values)
    again = decode(encode(central)).facts
    assert [(type(one), repr(one)) for one in again] == [(type(one), repr(one)) for one in values]


# --- refused states -------------------------------------------------------------------------------


def test_unencodable_value_is_named_with_its_path() -> None:
    player = Player.of("user")
    connection = player.central.registry.connections[ConnectionId(b"user")]
    connection.outstanding[7] = Flags  # type: ignore[assignment]  # a class cannot be part of the state
    with pytest.raises(ImageError, match=r"Connection\.outstanding value"):
        encode(player.central)


def test_set_is_refused_in_an_image() -> None:
    central = Player.of("user").central
    central.facts.append({"a"})  # type: ignore[arg-type]
    with pytest.raises(ImageError, match="item is a set"):
        encode(central)


@IN_PYTHON
def test_state_classes_have_no_instance_dict() -> None:
    """An image would omit attributes outside of the slots without an error."""
    kinds: list[Any] = [Central, Stored]
    for kind in kinds:  # the list grows during the loop
        kinds += kind.__subclasses__()
        assert not kind.__dictoffset__, kind


def test_only_state_classes_are_found_by_name() -> None:
    state = Player.of("planner: goal walk", "user").central
    for thing in (
        state,
        state.tree.root,
        state.tree.root.message.format,
        Role.NONE,
        Verdict("gone"),
    ):
        shape = shape_of(thing)
        assert shape is not None
        assert shape_named(shape.name) == shape
    for name in (
        "os.system",
        "tca_central.core.partial",
        "tca_central.core.State",
        "tca_central.image.decoder.Central",
        "x",
        "",
        "tca_central.shell.server.Server",
        "tca_central.core.HANDLERS",
        "tca_central.errors.ImageError",
    ):
        assert shape_named(name) is None, name


def test_image_is_refused_during_deadlock_search() -> None:
    central = Player.of("user").central
    central.scan = object()
    assert not can_encode(central)
    with pytest.raises(ImageError, match="deadlock"):
        encode(central)


# --- refused images -------------------------------------------------------------------------------


def image() -> bytes:
    life = Life()
    life.go_on(seed=2, events=60)
    return encode(life.central)


def test_damaged_image_raises_image_error() -> None:
    good, dice = image(), random.Random(1)
    for length in (0, 1, 9, 10, 20, 30, 40, len(good) // 2, len(good) - 1):
        with pytest.raises(ImageError):
            decode(good[:length])
    start = good.index(b"\n") + 1
    for _ in range(200):
        bad = bytearray(good)
        bad[dice.randrange(start, len(good))] ^= 1 << dice.randrange(8)
        with pytest.raises(ImageError):
            decode(bytes(bad))
    for foreign in (
        b"\n" * 99,
        b"tca image\n",
        b"tca image 1\n",
        good + b".",
        b"\x80\x04K\x01." * 20,
    ):
        with pytest.raises(ImageError):
            decode(foreign)


def test_unknown_image_format_is_named_in_the_error() -> None:
    rest = image().partition(b"\n")[2]
    with pytest.raises(ImageError, match="99 of 2"):
        decode(b"tca image 99 of 2.0\n" + rest)


def test_changed_layout_is_named_with_class_and_attribute() -> None:
    tables = container.unseal(image())
    table = next(table for table in tables if table.name.endswith(".Task"))
    fields = table.fields
    for changed, message in (
        ([*fields[:-1], "novelty"], f"Task has no novelty any more, Task now has {fields[-1]}"),
        (fields[::-1], "another order"),
    ):
        table.fields = changed
        with pytest.raises(ImageError, match=message):
            decode(container.seal(tables))
    table.name, table.fields = "Novelty", fields
    with pytest.raises(ImageError, match="Novelty"):
        decode(container.seal(tables))


def test_forged_image_raises_only_image_error() -> None:
    """A correct checksum does not prove that central has written the image."""
    dice = random.Random(3)
    good = image()
    for _ in range(300):
        tables = container.unseal(good)
        for _ in range(dice.randrange(1, 3)):
            table = dice.choice(tables)
            mutate(table, dice)
        with suppress(ImageError):
            assert isinstance(decode(container.seal(tables)), Central)


def mutate(table: container.ClassTable, dice: random.Random) -> None:
    """Change a random part of a table."""
    odd: list[Any] = [-1, 0, 1 << 40, None, "x", b"x", 1.5, [], [1], {}, 3]
    if not table.columns:
        table.name = "Novelty"
        return
    column = dice.choice(table.columns)
    match dice.randrange(6):
        case 0:
            table.count = dice.choice((0, -1, table.count + 1, 1 << 40))
        case 1:
            column.refers = not column.refers
        case 2:
            column.is_common = not column.is_common
        case 3:
            table.columns.remove(column)
        case _ if column.values:
            column.values[dice.randrange(len(column.values))] = dice.choice(odd)


def test_image_of_thousand_tasks_is_small() -> None:
    """The test bounds bytes, not time, because time depends on the machine."""
    assert len(encode(deep(1000))) < 150_000
