"""Errors of a replicated log: wrong servers and streams end central, an outage lets it wait."""

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nats
import pytest
from module.real_central import until
from nats.js.api import StreamConfig, StreamInfo
from nats_servers import NatsServers, free_port

from tca_central.errors import CentralError
from tca_central.replication import jetstream_connection
from tca_central.replication.jetstream import JetStreamLog
from tca_central.replication.log_checks import has_quorum
from tca_central.replication.shared_log import Kind, LogUnreachable, log_in
from tca_wire.log_address import without_secrets

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jetstream_connection, "PATIENCE", 0.8)
    for name in ("REPORT_AFTER", "_LAST_PATIENCE", "_REPLY_WITHIN"):
        monkeypatch.setattr(jetstream_connection, name, 0.3)


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NatsServers]:
    with started(tmp_path_factory.mktemp("nats")) as one:
        yield one


@contextmanager
def started(folder: Path, **options: Any) -> Iterator[NatsServers]:
    """One server that accepts connections."""
    found = NatsServers(folder, 1, **options)
    try:
        until(lambda: accepts(found.ports[0]), "the server listens")
        yield found
    finally:
        found.close()


def accepts(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def opened(address: str) -> Iterator[JetStreamLog]:
    log = JetStreamLog(*log_in(address))
    try:
        yield log
    finally:
        log.close()


def refusal(address: str) -> str:
    with pytest.raises(CentralError) as error, opened(address):
        pass
    return str(error.value)


def in_thread(act: Callable[[], object]) -> tuple[threading.Thread, list[object]]:
    """Call a function in a thread. The list gets its result, or its error."""
    results: list[object] = []

    def run() -> None:
        try:
            results.append(act())
        except CentralError as error:
            results.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, results


def test_unusable_server_is_named_with_the_reason(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, started(tmp_path, store=0) as bare:
        places = [free_port(), other.getsockname()[1], bare.ports[0]]
        said = refusal(f"nats://{','.join(f'127.0.0.1:{one}' for one in places)}/x")
    for place, why in zip(places, ["refused", "not a NATS server", "no JetStream"], strict=True):
        assert why in said.rpartition(f"{place} ")[2].partition(",")[0]


def test_unknown_host_is_reported() -> None:
    assert "no.such.host.invalid can't be reached" in refusal("nats://no.such.host.invalid/x")


def test_server_with_users_is_entered_by_its_address(tmp_path: Path) -> None:
    users = 'authorization { user: "rover", password: "secret" }'
    with started(tmp_path, more=users) as one:
        place = f"127.0.0.1:{one.ports[0]}/x"
        for wrong in (place, f"rover:wrong@{place}"):
            said = refusal(f"nats://{wrong}")
            assert "refuses the user" in said
            assert "wrong" not in said
        with opened(f"nats://rover:secret@{place}") as log:
            assert log.append(Kind.TURN, [b"a"], 0) == 1


def test_users_of_a_log_are_hidden_and_apply_to_all_servers() -> None:
    address = "nats://rover:secret@a,b:1/x"
    assert log_in(address)[0] == ["nats://rover:secret@a", "nats://rover:secret@b:1"]
    assert without_secrets(address) == "nats://a,b:1/x"


@pytest.mark.parametrize(
    "address",
    [
        "a:1/x",
        "http://a/x",
        "nats:///x",
        "nats://a:port/x",
        "nats://a:65536/x",
        "nats://a/x y",
        "nats://u:sec/ret@a/x",
    ],
)
def test_wrong_address_is_refused_without_its_secret(address: str) -> None:
    with pytest.raises(CentralError) as error:
        log_in(address)
    assert "ret" not in str(error.value)


def test_server_for_short_messages_is_refused(tmp_path: Path) -> None:
    with started(tmp_path, more="max_payload: 64KB") as one:
        assert "max_payload" in refusal(one.address("x"))


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"subjects": ["other.>"]}, "subjects"),
        ({"max_age": 60.0}, "max_age"),
        ({"max_msgs": 10, "storage": "memory"}, "storage and max_msgs"),
        ({"max_msg_size": 1000}, "max_msg_size"),
    ],
)
def test_stream_that_is_no_safe_log_is_refused(
    servers: NatsServers, options: dict[str, Any], why: str
) -> None:
    name = f"x{abs(hash(why))}"

    async def make() -> None:
        client = await nats.connect(servers.address().rpartition("/")[0])
        config = StreamConfig(**{"name": f"TCA-{name}", "subjects": [f"tca.{name}.log"], **options})
        await client.jetstream().add_stream(config)
        await client.close()

    asyncio.run(make())
    said = refusal(servers.address(name))
    assert f"TCA-{name}" in said
    assert why in said


def test_foreign_message_is_refused(servers: NatsServers) -> None:
    async def publish() -> None:
        client = await nats.connect(servers.address().rpartition("/")[0])
        await client.jetstream().publish("tca.foreign.log", b"hello")
        await client.close()

    with opened(servers.address("foreign")) as log:
        asyncio.run(publish())
        with pytest.raises(CentralError, match="TCA-foreign"):
            log.read(0, 1)


def test_append_waits_until_the_log_answers_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with started(tmp_path) as one, opened(one.address("x")) as log:
        last = log.append(Kind.TURN, [b"a"], 0)
        one.kill(0)
        thread, results = in_thread(lambda: log.append(Kind.TURN, [b"b", b"c"], last))
        until(lambda: bool(caplog.records), "the outage is reported")
        one.start(0)
        thread.join(30)
        assert results == [3]
        assert [message.data for message in log.read(0, 1)] == [b"a", b"b", b"c"]
    assert [line.levelno for line in caplog.records] == [logging.ERROR, logging.WARNING]


def test_waiting_central_ends_when_it_must(tmp_path: Path) -> None:
    with started(tmp_path) as one, opened(one.address("x")) as log:
        one.kill(0)
        thread, results = in_thread(lambda: log.append(Kind.TURN, [b"a"], 0))
        log.gives_up = lambda: True
        thread.join(10)
        assert [type(one) for one in results] == [LogUnreachable]
        assert log.read(0, 0.1) == []


def test_full_servers_let_central_wait_for_room(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with started(tmp_path, store=1 << 20) as one, opened(one.address("x")) as log:
        piece, last = bytes(400_000), 0
        for _ in range(2):
            last = log.append(Kind.TURN, [piece], last)
        thread, results = in_thread(lambda: log.append(Kind.TURN, [piece, piece, b"end"], last))
        until(lambda: "has no room" in caplog.text, "it is reported")
        assert not results
        one.kill(0)
        one.store = 1 << 30
        one.start(0)
        thread.join(30)
        assert results == [5]
        assert [message.sequence for message in log.read(0, 1)] == [1, 2, 3, 4, 5]


def test_deleted_stream_ends_the_run(servers: NatsServers) -> None:
    async def delete() -> None:
        client = await nats.connect(servers.address().rpartition("/")[0])
        await client.jetstream().delete_stream("TCA-gone")
        await client.close()

    with opened(servers.address("gone")) as log:
        log.append(Kind.TURN, [b"a"], 0)
        asyncio.run(delete())
        with pytest.raises(CentralError, match="was deleted"):
            log.append(Kind.TURN, [b"b"], 1)


def test_reader_gets_all_when_much_is_waiting(servers: NatsServers) -> None:
    """A server cuts a client for which more than 64 MiB wait."""
    with opened(servers.address("much")) as log:
        last = 0
        for _ in range(10):
            last = log.append(Kind.TURN, [bytes(500_000)] * 15, last)
        seen: list[int] = []
        while len(seen) < last:
            seen += [message.sequence for message in log.read(len(seen), 5)]
        assert seen == list(range(1, last + 1))


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ([{}, {}], True),
        ([{}, {"offline": True}], True),
        ([{"offline": True}, {"offline": True}], False),
        ([{"active": 10**10}, {"active": 10**10}], False),
        ([], True),
    ],
)
def test_quorum_needs_more_than_half_of_the_servers(
    states: list[dict[str, Any]], *, expected: bool
) -> None:
    replicas = [{"name": "s", "current": True, "active": 10, **state} for state in states]
    info = {
        "config": {"name": "x"},
        "state": {"messages": 0, "bytes": 0, "first_seq": 0, "last_seq": 0, "consumer_count": 0},
        "cluster": {"name": "c", "leader": "s0", "replicas": replicas},
    }
    assert has_quorum(StreamInfo.from_response(info)) is expected
