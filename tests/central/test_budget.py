"""The byte budget of central: its counters match the stored bytes, and stay within limits."""

import random
from collections.abc import Callable
from typing import Any

import pytest
from central.player import Player, point

from dev.invariants import check_invariants
from tca_central.events import ConnectionId, ConnectionLost, LimitsSet
from tca_central.model import registry
from tca_central.model.answers import REMEMBERED_ANSWERS
from tca_central.model.budget import ANSWER_BYTES, TASK_BYTES
from tca_central.requests import forgetting
from tca_central.status.topics import TOPICS
from tca_wire.constraints import Constraint, Flags
from tca_wire.packets import headers
from tca_wire.packets.large import LARGE, Handle, held_size, pack_handle
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Condition, Dropping, Limit, MessageClass, Refusal

MEMORY = 1 << 20


def of(*modules: str) -> Player:
    """Return a player whose central has a budget of one megabyte, half of it for messages and
    tasks.
    """
    player = Player.of(*modules)
    player.event(LimitsSet(0.0, MEMORY, 8, 20_000))
    return player


def refusal(sent: list[Any]) -> Refusal | None:
    return next((one.refusal for one in sent if isinstance(one, headers.Refused)), None)


def fill(player: Player, header: Any, body: bytes, most: int = 2000) -> int:
    """Send until a refusal. Return the number of accepted messages."""
    for count in range(most):
        request = {"number": player.number("user")} if header.number else {}
        sent = player.receive("user", type(header)(**{**_fields(header), **request}), body)
        if refusal(sent) is Refusal.OVERLOAD:
            return count
    pytest.fail("no message is refused")


def _fields(header: Any) -> dict[str, Any]:
    return {name: getattr(header, name) for name in header.__struct_fields__}


@pytest.mark.parametrize("message", ["note", "where", "move", "all", "pose"])
def test_queued_messages_are_bounded_in_bytes(message: str) -> None:
    player = of(
        "busy: inform note, query where, command move, multi-query all, broadcast pose", "user"
    )
    taken = fill(player, headers.Send(1, message), bytes(10_000))
    assert 40 <= taken <= 60
    assert player.central.message_bytes <= player.central.budget.messages
    refused = player.facts_of("refused")[-1]
    assert "messages and tasks hold 5" in refused.text
    assert "--memory" in refused.text
    assert player.central.budget.refused == 1
    player.reply("busy/1")  # one message has ended, so the next one is accepted
    player.request("user", headers.Send, message, body=b"\xc0")
    assert player.central.budget.refused == 1


def test_largest_message_fits_the_default_memory() -> None:
    player = Player.of("busy: inform image", "user")
    body = pack_handle(Handle("ab/7", Limit.LARGE, 0, bytes(LARGE)))
    answers = [player.request("user", headers.Send, "image", body=body)[-1] for _ in range(2)]
    assert isinstance(answers[0], headers.Accepted | headers.Deliver)
    assert answers[1].refusal is Refusal.OVERLOAD
    assert answers[1].text.startswith(f"no room for {held_size(body):,} bytes: messages and")


def test_unconfirmed_inform_is_dropped_and_counted_over_budget() -> None:
    player = of("busy: inform note", "user")
    for _ in range(60):
        player.receive("user", headers.Send(0, "note"), bytes(10_000))
    dropped = player.facts_of("dropped")
    assert dropped
    assert {fact.dropping for fact in dropped} == {Dropping.OVERLOAD}
    assert (
        player.central.registry.messages["note"].dropped
        == len(dropped)
        == player.central.budget.refused
    )
    load: Any = TOPICS["load"](player.central)
    assert load["overloads"] == len(dropped)
    assert load["memory"]["messages and tasks"][0] == player.central.message_bytes


def test_freeing_requests_are_accepted_over_budget() -> None:
    player = of("legs: command move, goal walk", "map: query where", "user")
    goal = player.task("user", "walk")
    tasks = [player.task("user", "move", under=goal) for _ in range(3)]
    player.request("user", headers.Lock, "map")
    player.request("user", headers.Send, "where", body=b"\xc0")
    query = player.numbers["user"]
    fill(player, headers.Send(1, "move", flags=Flags.NONE), bytes(10_000))
    player.central.budget.messages = player.central.budget.declared = 0
    for header in (
        headers.Suspend(player.number("user"), TaskId(goal)),
        headers.Suspend(player.number("user"), TaskId(goal), resume=True),
        headers.GiveUp(query),
        headers.Unlock(player.number("user"), "map"),
        headers.Ask(player.number("user"), "status"),
        headers.Unregister(player.number("user"), []),
        headers.Kill(player.number("user"), TaskId(tasks[-1])),
        headers.Kill(player.number("user"), TaskId(goal)),
    ):
        assert refusal(player.receive("user", header)) is None, header
    assert not isinstance(player.hello("late")[-1], headers.Refused)
    assert goal not in player.central.tree.tasks or player.central.tree.tasks[goal].killed


def test_results_and_termination_messages_count_in_the_budget() -> None:
    player = of("legs: command move, goal walk", "user")
    before = player.central.tree.bytes
    goal = player.task("user", "walk")
    held = player.central.tree.bytes
    assert held == before + TASK_BYTES + 1
    player.request("user", headers.Send, "move", TaskId(goal), body=bytes(5000), when_killed=True)
    assert player.central.tree.bytes > held + 5000
    child = player.task("user", "move", under=goal)
    player.receive("legs/1", headers.Reply(goal), bytes(3000))  # the goal waits for its child
    assert player.central.tree.bytes > held + 8000
    assert player.central.tree.tasks[child].is_running
    player.reply("legs/1")
    assert player.central.tree.bytes == before


DECLARED: dict[str, Callable[[int, TaskId], Any]] = {
    "waits": lambda number, task: headers.AwaitPoint(number, point(task, Moment.END_ACHIEVING)),
    "deadlines": lambda number, task: headers.Deadline(
        number, Point(task, Moment.END_ACHIEVING), 1000.0
    ),
    "kills": lambda number, task: headers.Kill(number, task, "x" * 10_000, delay=1000.0),
    "attachments": lambda number, task: headers.Attach(
        number, Attachment(f"f{number}", "recover"), task
    ),
    "wiretaps": lambda number, task: headers.Tap(
        number, Condition.WHEN_ACHIEVED, f"note {number % 8}", task=task
    ),
    "presence": lambda number, _: headers.WaitUntilHandled(number, ["recover"]),
    "delays": lambda number, task: headers.Constrain(
        number,
        [
            Constraint(
                Point(TaskId(0), Moment.START_ACHIEVING), Point(task, Moment.END_ACHIEVING), 9.0
            )
        ],
    ),
}


@pytest.mark.parametrize("what", DECLARED)
def test_requests_about_a_task_are_bounded_in_bytes(what: str) -> None:
    player = of("user")
    player.declare(
        "user",
        "command move",
        "exception handler recover",
        *(f"inform note {one}" for one in range(8)),
    )
    task = TaskId(player.task("user", "move"))
    player.central.budget.declared = player.central.declared_bytes + 2500
    answers = [player.request("user", DECLARED[what], task) for _ in range(8)]
    refused = [one for sent in answers for one in sent if isinstance(one, headers.Refused)]
    assert refused
    assert {one.refusal for one in refused} == {Refusal.OVERLOAD}
    assert player.central.declared_bytes <= player.central.budget.declared
    assert "declarations, attachments, claims, waits and timers hold" in refused[-1].text


# --- answers --------------------------------------------------------------------------------------


def ask(player: Player, connection: str, size: int) -> int:
    """Swap a variable for a value of *size* bytes. The answer holds the previous value."""
    number = player.number(connection)
    player.receive(connection, headers.SetVariable(number, "v", swap=True), bytes(size))
    return number


def test_oldest_answers_are_forgotten_first_over_budget() -> None:
    player = of(*(f"user{one}" for one in range(8)))
    users = [f"user{one}" for one in range(8)]
    for user in users:
        player.declare(user, "variable v")
    first = ask(player, "user0", 20_000)
    last = [ask(player, user, 20_000) for _ in range(5) for user in users][-1]
    assert player.central.answers.bytes <= player.central.budget.answers
    assert player.central.answers.forgotten > 0
    (too_late,) = player.receive("user0", headers.SetVariable(first, "v", swap=True), b"x")
    assert too_late.refusal is Refusal.TOO_LATE
    (again,) = player.receive("user7", headers.SetVariable(last, "v", swap=True), b"x")
    assert isinstance(again, headers.Answer)


def test_busy_connection_does_not_evict_answers_of_others() -> None:
    player = of("quiet", "user")
    for user in ("quiet", "user"):
        player.declare(user, "variable v")
    ask(player, "user", 10)
    first = ask(player, "quiet", 10)
    for _ in range(REMEMBERED_ANSWERS):
        ask(player, "user", 30_000)
    (answer,) = player.receive("quiet", headers.SetVariable(first, "v", swap=True), b"x")
    assert isinstance(answer, headers.Answer)


def test_answers_survive_connection_loss_but_not_goodbye() -> None:
    player = of("stays", "leaves")
    for user in ("stays", "leaves"):
        player.declare(user, "variable v")
        ask(player, user, 1000)
    held = player.central.answers.bytes
    player.event(ConnectionLost(player.time, ConnectionId(b"stays")))
    assert player.central.answers.bytes == held
    player.receive("leaves", headers.Bye())
    assert player.central.answers.bytes == 3 * ANSWER_BYTES
    player.hello("stays")
    (answer,) = player.receive(
        "stays", headers.SetVariable(player.numbers["stays"] - 1, "v", swap=True), b"x"
    )
    assert isinstance(answer, headers.Answer)


# --- names ----------------------------------------------------------------------------------------


def test_unneeded_message_names_make_room_for_new_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MESSAGES", 12)
    monkeypatch.setattr(forgetting, "AT_ONCE", 3)
    player = of("legs: command move", "keeper")
    player.declare("keeper", "exception handler recover", "inform seen")
    player.module("gone")
    names = [
        "goal held",
        "inform waiting",
        "command tapped",
        "command guarded",
        "variable value",
        *(f"inform {x}" for x in "abc"),
    ]
    player.declare("gone", *names)
    assert player.task("gone", "held")
    player.receive("gone", headers.Send(0, "waiting"), b"\xc0")
    player.set_variable("gone", "value", 5)
    player.request("keeper", headers.Attach, Attachment("", "recover"), message="guarded")
    player.request("keeper", headers.Tap, Condition.WHEN_SENT, "seen", "tapped")
    player.receive("gone", headers.Bye())
    player.module("new")
    (answer,) = player.declare("new", "inform d", "inform e")
    assert isinstance(answer, headers.Accepted)
    known = player.central.registry.messages
    assert not {"a", "b", "c"} & set(known)
    assert {
        "held",
        "waiting",
        "tapped",
        "guarded",
        "value",
        "move",
        "recover",
        "seen",
        "d",
        "e",
    } == set(known)
    player.central.registry.next_search = 0  # a repeated search would be skipped
    (answer,) = player.declare("new", "inform f", "inform g", "inform h")
    assert isinstance(answer, headers.Accepted)
    assert "waiting" not in known
    assert "value" in known  # a value is forgotten last
    player.central.registry.next_search = 0
    (answer,) = player.declare("new", "inform i")
    assert isinstance(answer, headers.Accepted)
    assert "value" not in known
    (answer,) = player.declare("new", "inform j")
    assert answer.refusal is Refusal.OVERLOAD
    player.declare("new", "goal held")
    player.module("planner", "goal held")  # the waiting task is delivered
    assert player.delivered("planner/1")


def test_unhandled_inform_names_are_freed_after_sender_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "MESSAGES", 12)
    monkeypatch.setattr(forgetting, "AT_ONCE", 4)
    player = Player.of("stays", "leaves")
    player.declare("stays", "inform kept")
    player.declare("leaves", "inform kept", "query asked", *(f"inform {one}" for one in "abcdefgh"))
    for name in ("kept", *"hgfedcbaa"):  # two messages 'a' wait, so forgetting 'a' loses more
        player.receive("leaves", headers.Send(0, name), b"\xc0")
    player.request("leaves", headers.Send, "asked", body=b"\xc0")
    player.declare("stays", "inform i", "inform j")
    (refused,) = player.declare("stays", "inform l")  # the sender of 'a' to 'h' is still connected
    assert refused.refusal is Refusal.OVERLOAD
    player.receive("leaves", headers.Bye())
    held, refusals = player.central.dispatcher.bytes, player.central.budget.refused
    (answer,) = player.declare("stays", "inform l")
    assert isinstance(answer, headers.Accepted)
    known = player.central.registry.messages
    # 'asked' is forgotten, too: none of its messages waits.
    assert [one for one in "abcdefgh" if one not in known] == ["b", "c"]
    assert "kept" in known
    dropped = [fact for fact in player.facts_of("dropped") if fact.dropping is Dropping.OVERLOAD]
    assert [fact.message for fact in dropped] == ["b", "c"]
    assert player.central.budget.refused == refusals + 2
    status: Any = TOPICS["status"](player.central)
    assert status["dropped"] == len(dropped)
    assert player.central.dispatcher.bytes < held
    player.module("late", "inform a", "inform kept")  # messages that were not lost are delivered
    for _ in range(3):
        player.reply("late/1")
    assert not player.central.registry.messages["a"].waiting
    assert len(player.facts_of("returned")) == 3


def test_name_limit_counts_all_messages_of_a_request(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MESSAGES", 5)
    player = Player.of("user")
    (answer,) = player.declare("user", *(f"inform {one}" for one in range(6)))
    assert answer.text == "5 messages have been declared: '5' is too many"
    assert not player.central.registry.messages


def test_formats_are_bounded_in_bytes() -> None:
    player = of("user")
    answers = []
    for one in range(10):
        declared = MessageFormat(f"m{one}", MessageClass.INFORM, "x" * 10_000)
        answers += player.request("user", headers.Register, [declared])
    assert isinstance(answers[0], headers.Accepted)
    assert answers[-1].refusal is Refusal.OVERLOAD
    player.receive("user", headers.Bye())
    player.module("next")
    declared = MessageFormat("m", MessageClass.INFORM, "x" * 10_000)
    player.central.registry.next_search = 0
    (answer,) = player.request("next", headers.Register, [declared])
    assert isinstance(answer, headers.Accepted)


# --- hostile lives --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_central_stays_within_budget_in_hostile_lives(seed: int) -> None:
    """The invariants, checked after each burst, recount all stored bytes."""
    player = of(
        "legs: command move, goal walk, query where",
        "map: inform note, broadcast pose, multi-query all",
        "user",
    )
    player.check = False
    player.module(
        "ears", "exception handler recover", "broadcast pose", "multi-query all", "variable v"
    )
    player.declare("user", "variable v", "inform hear")
    chance, most = random.Random(seed), 0
    for _ in range(15):
        for _ in range(80):
            _do_anything(player, chance)
            central = player.central
            most = max(most, central.message_bytes)
            assert central.answers.bytes <= central.budget.answers
            assert central.declared_bytes <= central.budget.declared
        check_invariants(player.central)
    # Exception handlers are accepted over budget, each with the data of its failure.
    assert player.central.budget.messages // 2 < most <= 1.5 * player.central.budget.messages
    assert player.central.budget.refused


def _do_anything(player: Player, chance: random.Random) -> None:
    number, task = (
        player.number("user"),
        TaskId(chance.randint(1, max(player.central.tree.newest, 1))),
    )
    body = bytes(chance.choice((1, 1000, 60_000, 200_000)))
    send = headers.Send(
        chance.choice((number, number, 0)), chance.choice(("note", "pose")), origin=0
    )
    choices: list[tuple[Any, bytes]] = [
        (send, body),
        (headers.Send(number, chance.choice(("where", "all"))), body),
        (
            headers.Send(number, chance.choice(("move", "walk")), chance.choice((task, TaskId(0)))),
            body,
        ),
        (headers.Send(number, "move", task, when_killed=True), body),
        (headers.SetVariable(number, "v", swap=chance.random() < 0.5), body),
        (headers.AwaitPoint(number, Point(task, Moment.END_ACHIEVING)), b""),
        (
            headers.Deadline(
                number, Point(task, Moment.END_ACHIEVING), chance.choice((5.0, 5000.0))
            ),
            b"",
        ),
        (headers.Attach(number, Attachment(f"f{chance.randint(0, 50)}", "recover"), task), b""),
        (
            headers.Tap(
                number, Condition.AFTER_ACHIEVED, chance.choice(("move", "hear")), task=task
            ),
            b"",
        ),
        (headers.Kill(number, task, delay=chance.choice((0.0, 100.0))), b""),
        (headers.GiveUp(chance.randint(1, number)), b""),
        (headers.Retry(number, task, new_data=True), body),
        (headers.Raise(number, task, "f1", "why"), body),
        (headers.Register(number, [], [HandlerFormat("note", chance.choice("abc"))]), b""),
    ]
    header, body = chance.choice(choices)
    player.receive("user", header, body)
    for slot in ("legs/1", "map/1", "ears/1"):
        if chance.random() < 0.15 and (delivered := player.delivered(slot)):
            answer = chance.choice(
                (headers.Reply(delivered[-1]), headers.Fail(delivered[-1], "f1", "slipped"))
            )
            player.receive(slot, answer, bytes(chance.choice((1, 20_000))))


def test_search_for_free_names_is_repeated_after_a_departure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A search without result is normally repeated only after many events."""
    monkeypatch.setattr(registry, "MESSAGES", 60)
    monkeypatch.setattr(forgetting, "STEPS", 1)
    player = Player.of("keeper", "full")
    player.declare("full", *(f"inform name{number}" for number in range(60)))
    assert isinstance(player.declare("keeper", "inform fresh")[0], headers.Refused)
    player.receive("full", headers.Bye())
    assert isinstance(player.declare("keeper", "inform fresh")[0], headers.Accepted)


def test_late_failure_of_abandoned_multi_query_holds_nothing() -> None:
    player = of("map: multi-query where", "camera: multi-query where", "user")
    player.send("user", "where")
    player.receive("user", headers.GiveUp(player.numbers["user"]))
    sent = player.receive(
        "map/1", headers.Fail(player.delivered("map/1")[0], "no idea", "why"), bytes(500)
    )
    assert player.central.budget.collector_bytes == 0
    sent += player.reply("camera/1")
    assert not any(isinstance(one, headers.Answer) for one in sent)
    assert not player.central.collectors
