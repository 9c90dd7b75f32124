"""Hostile values in requests: names with control characters, implausible numbers, long texts."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from central.player import INTEGER, Player, point

from tca_central.events import (
    Arrived,
    ConnectionId,
    DiskSpace,
    Input,
    LimitsSet,
    RequestReceived,
    Restarted,
    Tick,
)
from tca_central.inputs import events_of
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Dropped, Failed
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.codec import pack_item
from tca_wire.packets.headers import Accepted, Ask, Refused
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Limit, MessageClass, Refusal

BAD_NAMES = ("\x1b[2J", "two\nlines", "a\x00", "\u202egnp.exe", "\u2028", "x" * 129, "   ")


@pytest.fixture
def player() -> Player:
    return Player.of("legs: command move, inform note", "expert: exception handler recover", "user")


def hello(**fields: Any) -> headers.Hello:
    options: dict[str, Any] = {"module": "new", "incarnation": "run of new", **fields}
    return headers.Hello(1, headers.PROTOCOL_VERSION, **options)


@pytest.mark.parametrize("name", BAD_NAMES)
def test_unprintable_name_is_refused_in_printable_words(player: Player, name: str) -> None:
    formats = [MessageFormat(name, MessageClass.INFORM, INTEGER)]
    for header in (
        headers.Register(player.number("user"), formats),
        headers.Register(player.number("user"), [], [HandlerFormat("move", name)]),
        headers.Register(player.number("user"), [], [HandlerFormat("move", "arms", name)]),
        headers.Attach(player.number("user"), Attachment(name, "recover")),
        headers.Send(player.number("user"), "move", attachments=[Attachment(name, "recover")]),
    ):
        (answer,) = player.receive("user", header)
        assert isinstance(answer, Refused), header
        assert answer.refusal is Refusal.PROTOCOL
        assert answer.text.isprintable()
    for greeting in (
        hello(module=name),
        hello(resource=name),
        hello(process=name),
        hello(incarnation=name),
    ):
        (answer,) = player.receive("new", greeting)
        assert answer.text.isprintable()
        assert isinstance(answer, Refused), greeting


def test_hello_without_incarnation_is_refused(player: Player) -> None:
    (answer,) = player.receive("new", hello(incarnation=""))
    assert answer.text == "'' names no incarnation: give 1 to 128 printable characters"


def test_failure_with_hostile_name_is_recorded_escaped(player: Player) -> None:
    task = player.task("user", "move")
    player.receive("legs/1", headers.Fail(task, "\x1b[2Jslipped" + "x" * 500, kinds=["a\nb"]))
    (failed,) = player.facts(Failed)
    assert failed.failure.startswith("\\x1b[2Jslippedxxx")
    assert len(failed.failure) == Limit.NAME


def test_handler_named_twice_in_a_request_is_removed_once(player: Player) -> None:
    (answer,) = player.request("legs", headers.Unregister, ["note", "note"])
    assert isinstance(answer, Accepted)
    assert list(player.central.registry.modules["run of legs"].handlers) == ["move"]


def test_long_kill_reason_and_refusal_are_truncated(player: Player) -> None:
    task = player.task("user", "move")
    player.request("user", headers.Kill, TaskId(task), "why" * 100_000)
    assert len(player.facts_of("killed")[-1].why) <= Limit.TEXT + 100
    (answer,) = player.request("user", headers.Send, "name" * 100_000)
    assert len(answer.text) <= Limit.TEXT


def test_oversized_body_is_refused_with_both_sizes(player: Player) -> None:
    body = bytes(Limit.BODY + 1)
    (answer,) = player.request("user", headers.Send, "note", body=body)
    assert (
        answer.text
        == "a body of 8,388,609 bytes; at most 8,388,608 are allowed: send a reference to the data instead"
    )
    assert not player.facts(Dropped)
    assert isinstance(
        player.request("user", headers.Send, "note", body=body[1:])[-1], headers.Deliver | Accepted
    )


def test_oversized_reply_fails_the_task_and_frees_the_slot(player: Player) -> None:
    task = player.task("user", "move")
    player.request("user", headers.Send, "move", body=b"\x07")
    answers = player.receive("legs/1", headers.Reply(task), bytes(Limit.BODY + 1))
    (failed,) = player.facts(Failed)
    assert "its answer has a body of 8,388,609 bytes" in failed.text
    assert any(
        isinstance(answer, headers.Deliver) for answer in answers
    )  # the slot gets the next message


def test_first_arrival_counts_as_oldest_when_times_are_equal(player: Player) -> None:
    """Without this rule, the result would depend on the internal order of a heap."""
    player.task("user", "move")
    for name in ("move", "note", "move"):
        player.send("user", name, flags=Flags.NONE, number=player.number("user"))
        player.time -= 1.0
    player.request("user", headers.Kill, TaskId(2))
    (answer, *_) = player.request("user", headers.Ask, "load")
    load = msgspec.msgpack.decode(player.inbox["user"][-1][1])
    assert isinstance(answer, headers.Answer)
    assert [one["name"] for one in load["waits"]] == ["note"]


@pytest.mark.parametrize(
    "header",
    [
        Observe(0),
        headers.AwaitPoint(0, point(1, Moment.END_ACHIEVING)),
        headers.GetVariable(0, "mode"),
        headers.Lock(0, "legs"),
        headers.WaitUntilHandled(0, ["move"]),
        headers.Send(0, "where"),
    ],
    ids=lambda header: type(header).__name__,
)
def test_waiting_request_without_number_is_refused(header: Any) -> None:
    player = Player.of("legs: command move, query where, variable mode", "user")
    player.send("user", "move")
    for _ in range(2):  # the second request would count as a repetition of the first
        (answer,) = player.receive("user", header)
        assert answer.refusal is Refusal.PROTOCOL
    assert not player.central.registry.connections[ConnectionId(b"user")].outstanding


def test_open_request_stays_when_its_number_is_used_again(player: Player) -> None:
    player.request("user", Observe)
    number = player.numbers["user"]
    (answer,) = player.receive("user", headers.GetVariable(number, "no\nname"))
    assert isinstance(answer, Accepted)
    assert number in player.central.registry.connections[ConnectionId(b"user")].outstanding


@pytest.mark.parametrize("option", ["period", "duration"])
@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1.0])
def test_polling_monitor_with_invalid_time_is_refused(option: str, seconds: float) -> None:
    player = Player.of("legs: query where, command move", "user")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["where", "move"])
    player.request("user", headers.Register, [watch])
    (answer,) = player.send(
        "user",
        "watch",
        watch=msgspec.structs.replace(WatchOptions(period=1.0), **{option: seconds}),
    )
    assert isinstance(answer, Refused)
    assert answer.refusal is Refusal.PROTOCOL


# --- inputs that no central has written -----------------------------------------------------------


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1.0, 1e300])
@pytest.mark.parametrize(
    "at",
    [
        Tick,
        lambda it: DiskSpace(it, True),
        lambda it: LimitsSet(it, 1, 1, 1),
        lambda it: Restarted(1.0, it, 10.0),
        lambda it: Restarted(1.0, 0.0, it),
    ],
    ids=["tick", "disk space", "limits", "away", "grace"],
)
def test_input_with_invalid_time_fails_validation(
    at: Callable[[float], Input], seconds: float
) -> None:
    """With an infinite time, a periodic monitor would test for ever. A journal with NaN would not
    equal itself.
    """
    with pytest.raises(msgspec.ValidationError):
        msgspec.msgpack.decode(msgspec.msgpack.encode(at(seconds)), type=Input)


def test_spared_index_beyond_last_request_is_ignored() -> None:
    arrived = Arrived(1.0, ConnectionId(b"user"), pack_item(Ask(1, "status")))
    assert [type(one) for one in events_of(arrived, spared=7)] == [RequestReceived]
