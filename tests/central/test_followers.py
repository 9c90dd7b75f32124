"""Followers of a replicated log read what the leader appends, and take over by an append."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
from central.player import Player
from log_model import LogModel, Lost, ModelLog, SoundLink

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import DiskSpace, Input
from tca_central.image.encoder import encode as image_of
from tca_central.replication.follower import FollowedRunLost, Follower
from tca_central.replication.member import Member
from tca_central.replication.records import Image, Pieces, Term, Turn, encode
from tca_central.replication.shared_inputs import SharedInputs
from tca_central.replication.shared_log import Deposed, Kind, LogUnreachable, Message, cut
from tca_central.shell.input_log import INPUT_VERSION, Ended
from tca_central.shell.store import Store
from tca_wire.journal.facts import Entry
from tca_wire.packets.headers import PROTOCOL_VERSION

T = TypeVar("T")
AT = "tcp://one:5555"
TERM = Term(INPUT_VERSION, PROTOCOL_VERSION, "0.2.0", "run", True, "one:5", AT, "")
LOW, OK = DiskSpace(1.0, True), DiskSpace(2.0, False)


class Reader:
    """A follower, and the entries that it writes."""

    def __init__(self, model: LogModel, key: str = "") -> None:
        self.entries: list[Entry] = []
        self.follower = Follower(ModelLog(model), self._write, key=key)

    def _write(self, _: Central, entries: Sequence[Entry]) -> None:
        self.entries += entries

    def read(self) -> None:
        while self.follower.follow(0.1):
            pass


def leading(model: LogModel, tmp_path: Path, key: str = "") -> tuple[Follower, SharedInputs]:
    """Return a follower that has taken over, and its log of inputs."""
    reader = Reader(model, key)
    reader.read()
    assert reader.follower.take_over(AT)
    assert reader.follower.central is not None
    epoch, log = reader.follower.central.epoch, ModelLog(model)
    return reader.follower, SharedInputs(log, reader.follower.last, "one:5", epoch, tmp_path)


def append(inputs: SharedInputs, *events: Input) -> None:
    for event in events:
        inputs.add(event)
    inputs.flush()


def test_follower_has_the_state_and_entries_of_the_leader(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    append(inputs, LOW)
    reader = Reader(model)
    reader.read()
    assert reader.follower.central is not None
    assert reader.follower.central.is_disk_low
    assert [entry.number for entry in reader.entries] == [1]


def test_takeover_fails_when_the_log_has_later_messages(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    reader = Reader(model)
    reader.read()
    append(inputs, LOW)
    assert not reader.follower.take_over(AT)
    reader.read()
    assert reader.follower.take_over(AT)


def test_leader_is_deposed_by_a_takeover(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    reader = Reader(model)
    reader.read()
    assert reader.follower.take_over(AT)
    for _ in range(2):
        with pytest.raises(Deposed):
            append(inputs, LOW)
    reader.read()
    assert reader.follower.central is not None
    assert not reader.follower.central.is_disk_low


def append_image(inputs: SharedInputs, central: Central) -> int:
    """Append an image, after a turn and before another one. Return its number."""
    append(inputs, LOW)
    number = inputs.next_segment(0.0)
    (inputs.folder / f"{number:08d}.tcas").write_bytes(image_of(central))
    inputs.use_image(number, 0)
    append(inputs, OK)
    append(inputs)
    return number


def test_follower_starts_from_an_image_among_turns(tmp_path: Path) -> None:
    model = LogModel()
    leader, inputs = leading(model, tmp_path)
    player = Player.of("user")
    ModelLog(model).remove(append_image(inputs, player.central) + 1)
    reader = Reader(model)
    reader.read()
    assert reader.follower.central is not None
    assert reader.follower.central.event_count == player.central.event_count + 1
    assert leader.central is not None


def test_log_keeps_the_messages_since_the_last_image_but_one(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    numbers = [append_image(inputs, Player.of("user").central) for _ in range(3)]
    assert model.first == numbers[1] + 1


def test_slow_follower_learns_that_its_run_was_removed(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    reader = Reader(model)
    reader.read()
    append(inputs, LOW)
    append(inputs, OK)
    ModelLog(model).remove(model.last)
    with pytest.raises(FollowedRunLost):
        reader.read()


def test_new_run_follows_one_that_has_ended(tmp_path: Path) -> None:
    model = LogModel()
    _, inputs = leading(model, tmp_path)
    inputs.end("over")
    reader = Reader(model)
    reader.read()
    assert reader.follower.ended == Ended("over")
    first = reader.follower.central
    assert reader.follower.take_over(AT)
    assert reader.follower.central is not first


def test_central_with_other_keys_is_refused(tmp_path: Path) -> None:
    model = LogModel()
    leading(model, tmp_path, key="A")
    with pytest.raises(CentralError, match="keys"):
        Reader(model, key="B").read()


def test_log_of_another_version_is_refused() -> None:
    newer = encode(msgspec.structs.replace(TERM, version=INPUT_VERSION + 1))
    with pytest.raises(CentralError, match=r"0\.2\.0"):
        Pieces().add(Message(1, Kind.TERM, newer))


class SlowLink(SoundLink):
    """A link on which a wait takes two seconds longer."""

    def wait(self, seconds: float, is_over: Callable[[], bool]) -> None:
        super().wait(seconds + 2.0, is_over)


def test_wait_for_a_log_that_stalls_is_no_silence(tmp_path: Path) -> None:
    model = LogModel()
    leading(model, tmp_path)
    logs = ModelLog(model), ModelLog(model, SlowLink(model.clock))
    silences = []
    for log in logs:
        follower = Follower(log, lambda _central, _entries: None, clock=model.clock)
        for _ in range(4):
            follower.follow(0.5)
        silences.append(follower.silence)
    assert silences == [1.5, 0.0]


class CutLink(SoundLink):
    """A link that loses everything while it is cut."""

    is_cut = True

    def send(self, apply: Callable[[], T]) -> T:
        if self.is_cut:
            raise Lost
        return apply()


def test_nothing_is_appended_after_a_first_failure(tmp_path: Path) -> None:
    model = LogModel()
    leader, inputs = leading(model, tmp_path)
    link = CutLink(model.clock)
    inputs = SharedInputs(ModelLog(model, link), leader.last, "one:5", "run", tmp_path)
    last = model.last
    with pytest.raises(LogUnreachable):
        append(inputs, LOW)
    link.is_cut = False
    with pytest.raises(LogUnreachable):
        append(inputs, OK)
    assert model.last == last


# --- records in pieces ----------------------------------------------------------------------------


def test_record_in_pieces_is_joined() -> None:
    pieces = Pieces()
    data = encode([LOW])
    assert pieces.add(Message(1, Kind.TURN, data[:3], 0, True)) is None
    assert pieces.add(Message(2, Kind.TURN, data[3:], 1)) == Turn(2, [LOW])


def test_image_in_pieces_lies_between_turns() -> None:
    pieces = Pieces()
    first, *others = cut(encode(Image(7, "run", bytes(1 << 20))))
    assert pieces.add(Message(1, Kind.IMAGE, first, 0, True)) is None
    assert pieces.add(Message(2, Kind.TURN, encode([LOW]))) == Turn(2, [LOW])
    for part, piece in enumerate(others, 1):
        image = pieces.add(Message(2 + part, Kind.IMAGE, piece, part, part < len(others)))
    assert isinstance(image, Image)


def test_term_discards_a_record_without_an_end() -> None:
    pieces = Pieces()
    pieces.add(Message(1, Kind.TURN, b"half", 0, True))
    assert pieces.add(Message(2, Kind.TERM, encode(TERM))) == TERM
    assert pieces.add(Message(3, Kind.TURN, encode([LOW]))) == Turn(3, [LOW])


def test_rest_of_a_record_without_its_start_is_ignored() -> None:
    pieces = Pieces()
    assert pieces.add(Message(5, Kind.IMAGE, b"rest", 1)) is None
    assert pieces.add(Message(6, Kind.TURN, encode([LOW]))) == Turn(6, [LOW])


def test_standby_ends_if_the_run_it_had_followed_has_ended(tmp_path: Path) -> None:
    model = LogModel()
    leading(model, tmp_path)[1].end("SIGTERM")
    member = Member(ModelLog(model), AT, tmp_path / "journal", Store())
    looks = iter([False] * 10)
    assert not member.stand_by(lambda: next(looks), has_followed=True)
    member.close()
