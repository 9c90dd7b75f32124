"""The model of the log's engine does what the real engine and its client do."""

import random
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from log_model import LogModel, ModelLog
from nats_servers import NatsServers

from tca_central.replication.jetstream import JetStreamLog
from tca_central.replication.shared_log import PIECE_BYTES, Deposed, Kind, Message, log_in

BODIES = ["one/1", "one/2", "two/1"]


def _finish(log: JetStreamLog) -> None:
    """Let background work end, which continues during calls."""
    while log._begun:
        log.last()


class Both:
    """Clients of the real engine and of the model, which get the same calls."""

    def __init__(self, servers: NatsServers, name: str, dice: random.Random) -> None:
        self.dice, self.model = dice, LogModel()
        self._place = log_in(servers.address(name))
        self.real = [JetStreamLog(*self._place) for _ in range(3)]
        self.modelled = [ModelLog(self.model) for _ in self.real]
        self.counts: dict[str, int] = {}

    def do(self) -> None:
        """Do something with one of the clients, and compare the results."""
        number = self.dice.randrange(len(self.real))
        kinds = [self._append] * 4 + [self._read] * 3
        kinds += [self._remove, self._put, self._get, self._remove_body]
        self.dice.choice(kinds)(self.real[number], self.modelled[number])

    def _append(self, real: JetStreamLog, modelled: ModelLog) -> None:
        dice, last = self.dice, self.model.last
        after = last if dice.random() < 0.6 else max(0, last + dice.choice((-3, -2, -1)))
        sizes = [dice.choice((0, 1, 10, 1000)) for _ in range(dice.choice((1, 1, 1, 2, 3)))]
        pieces, kind = [dice.randbytes(size) for size in sizes], dice.choice(list(Kind))
        options: dict[str, Any] = {"part": dice.choice((0, 0, 1)), "is_more": dice.random() < 0.2}
        self._compare(
            "append", lambda one: _appended(one, kind, pieces, after, options), (real, modelled)
        )

    def _read(self, real: JetStreamLog, modelled: ModelLog) -> None:
        last = self.model.last
        after = max(0, last - self.dice.choice((0, 1, 2, 5, 100)))
        expected = modelled.read(after, 0.0)
        found: list[Message] = []
        while len(found) < max(1, len(expected)) and (
            more := real.read(found[-1].sequence if found else after, 0.02)
        ):
            found += more
        self._note("read", found, expected)

    def _remove(self, real: JetStreamLog, modelled: ModelLog) -> None:
        before = max(1, self.model.last - self.dice.choice((0, 1, 4, 20)))
        for one in (real, modelled):
            one.remove(before)
        _finish(real)

    def _put(self, real: JetStreamLog, modelled: ModelLog) -> None:
        name, size = self.dice.choice(BODIES), self.dice.choice((1, 5000, 2 * PIECE_BYTES + 1))
        data = self.dice.randbytes(1) * size
        self._compare("put", lambda one: one.put_body(name, data), (real, modelled))

    def _get(self, real: JetStreamLog, modelled: ModelLog) -> None:
        name = self.dice.choice(BODIES)
        self._compare("get", lambda one: one.body(name), (real, modelled))
        self._compare("names", lambda one: sorted(one.bodies()), (real, modelled))

    def _remove_body(self, real: JetStreamLog, modelled: ModelLog) -> None:
        name = self.dice.choice(BODIES)
        for one in (real, modelled):
            one.remove_body(name)
        _finish(real)

    def _compare(self, what: str, do: Callable[[Any], object], logs: Sequence[object]) -> None:
        self._note(what, *map(do, logs))

    def _note(self, what: str, found: object, expected: object) -> None:
        assert found == expected, what
        what += " nothing" * (found in ([], None))
        what += " refused" * (found == "deposed")
        self.counts[what] = self.counts.get(what, 0) + 1

    def close(self) -> None:
        """Disconnect."""
        for one in self.real:
            one.close()


def _appended(
    log: JetStreamLog | ModelLog,
    kind: Kind,
    pieces: list[bytes],
    after: int,
    options: dict[str, Any],
) -> int | str:
    try:
        return log.append(kind, pieces, after, **options)
    except Deposed:
        return "deposed"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NatsServers]:
    servers = NatsServers(tmp_path_factory.mktemp("nats"), 1)
    yield servers
    servers.close()


def compare(servers: NatsServers, seed: int, number: int) -> dict[str, int]:
    """Do a number of things with the model and the real engine. Return what was done."""
    both = Both(servers, f"model-{seed}", random.Random(seed))
    try:
        for _ in range(number):
            both.do()
    finally:
        both.close()
    return both.counts


def test_model_does_what_the_engine_does(server: NatsServers) -> None:
    counts = compare(server, 1, 200)
    kinds = ("append", "append refused", "read", "read nothing", "get", "get nothing")
    assert min(counts[kind] for kind in kinds) > 0, counts


def test_refused_append_leaves_no_later_piece(server: NatsServers) -> None:
    place = log_in(server.address("pieces"))
    one, other = JetStreamLog(*place), JetStreamLog(*place)
    other.append(Kind.TERM, [b"term"], 0)
    with pytest.raises(Deposed):
        one.append(Kind.TURN, [b"first", b"second"], 0)
    assert other.append(Kind.TURN, [b"turn"], 1) == 2
    one.close()
    other.close()


def test_read_begins_where_it_is_asked_after_an_empty_read(server: NatsServers) -> None:
    log = JetStreamLog(*log_in(server.address("reads")))
    log.append(Kind.TERM, [b"term"], 0)
    assert log.read(1, 0.02) == []
    assert [one.sequence for one in log.read(0, 0.02)] == [1]
    log.close()


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # a reconnect of nats-py closes no stream
def test_append_does_not_depose_when_servers_stand_still(tmp_path: Path) -> None:
    servers = NatsServers(tmp_path)
    log = JetStreamLog(*log_in(servers.address()))
    assert log.append(Kind.TERM, [b"term"], 0) == 1
    info = log._line.call(log._line.api.stream_info(log._line.stream))
    assert info.cluster is not None
    others = [one for one in range(3) if info.cluster.leader != f"s{one}"]
    for one in others:
        servers.stop(one)
    resume = threading.Timer(4.0, lambda: list(map(servers.resume, others)))
    resume.start()
    assert log.append(Kind.TURN, [b"turn"], 1) == 2
    resume.join()
    log.close()
    servers.close()


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(2, 12))
def test_model_does_what_three_servers_do(seed: int, tmp_path: Path) -> None:
    servers = NatsServers(tmp_path)
    try:
        compare(servers, seed, 500)
    finally:
        servers.close()
