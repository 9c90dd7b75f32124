"""Queries, multi-queries, informs and broadcasts between modules."""

import threading
from typing import Any

import pytest
from module.real_central import SOON
from module.robot import (
    ALARM,
    COLLISION,
    HEALTH,
    MOVE_LEG,
    POSITION,
    REST,
    STANCE,
    TEMPERATURE,
    WALK,
    Arc,
    Footfall,
)

from tca_module import (
    BadData,
    Client,
    Command,
    Failure,
    FormatRefused,
    MisuseError,
    Module,
    Outcome,
    Query,
    QueryFailed,
    SentTask,
    Task,
    TaskFailed,
    Timeout,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Dropped, Received


def test_sent_queries_are_received_in_any_order(legs: Module, user: Client) -> None:
    """The handler may join after the queries were sent."""
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    pending = [user.query_send(STANCE, float(number)) for number in range(3)]
    with legs.running():
        assert [one.receive(SOON) for one in reversed(pending)] == [[2], [1], [0]]
        assert pending[0].receive(0) == [0]


def test_unanswered_query_times_out_with_reason(user: Client, central: LocalCentral) -> None:
    with pytest.raises(Timeout) as caught:
        user.query(TEMPERATURE, timeout=0.01)
    assert str(caught.value) == (
        "query 'temperature' was not answered within 0.01 s: no module handles it; to wait longer give timeout="
    )
    assert isinstance(caught.value, TimeoutError)
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == [
        "no module handles it"
    ]


def test_abandoned_query_is_not_handled(legs: Module, user: Client, central: LocalCentral) -> None:
    handled = []

    @legs.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        handled.append(1)
        return 36.6

    pending = user.query_send(TEMPERATURE)
    pending.cancel()
    pending.cancel()
    with pytest.raises(MisuseError, match="query 'temperature' was given up"):
        pending.receive()
    with legs.running():
        assert user.query(TEMPERATURE) == 36.6
    assert handled == [1]
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == [
        "no module handles it"
    ]


def test_handler_queries_its_own_resource(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        return [int(radius), *task.query(STANCE, radius - 1, timeout=SOON)] if radius > 1 else [1]

    with legs.running():
        assert user.query(STANCE, 4.0, timeout=SOON) == [4, 3, 2, 1]
    received = [fact for fact in central.facts if isinstance(fact, Received)]
    assert [(fact.origin, fact.blocking) for fact in received] == [
        (0, True),
        (1, True),
        (2, True),
        (3, True),
    ]


def test_deadlock_names_the_limit_when_waits_nest_too_deep(legs: Module, user: Client) -> None:
    count = Command("count", int, result=int)

    @legs.handles(count)
    def counts(task: Task, depth: int) -> int:
        return 1 + task.command(count, depth - 1).result() if depth > 1 else 1

    with legs.running():
        assert user.command(count, 20).result(SOON) == 20
        with pytest.raises(TaskFailed, match=r"deadlock: .*nested deeper than 20"):
            user.command(count, 21).result(SOON)


def test_handler_fetches_reply_of_own_resource_later(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        if radius <= 1:
            return [1]
        pending = [task.query_send(STANCE, radius - 1) for _ in range(2)]
        assert not task.cancelled  # reading ``cancelled`` handles the packets that have arrived
        return [int(radius), *pending[1].receive(SOON), *pending[0].receive(SOON)]

    with legs.running():
        assert user.query(STANCE, 3.0, timeout=SOON) == [3, 2, 1, 1, 2, 1, 1]


def test_failed_query_carries_failure_and_data(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        if radius < 0:
            raise COLLISION(Footfall(3, 0.5), "leg 3 hit a rock")
        return [round(1 / radius)]

    with legs.running():
        with pytest.raises(
            QueryFailed, match="query 'stance' failed: collision: leg 3 hit a rock"
        ) as failed:
            user.query(STANCE, -1.0)
        assert failed.value.failure == "collision"
        assert failed.value.data_as(COLLISION) == Footfall(3, 0.5)
        assert failed.value.data == {"leg": 3, "height": 0.5}
        with pytest.raises(
            QueryFailed, match=r"handler error: ZeroDivisionError: float division by zero$"
        ) as error:
            user.query(STANCE, 0.0)
        assert "return [round(1 / radius)]" in error.value.text
        assert "handlers.py" not in error.value.text
        with pytest.raises(MisuseError, match="this is failure 'handler error', not 'collision'"):
            error.value.data_as(COLLISION)


def test_wrong_data_is_rejected_before_sending(user: Client, central: LocalCentral) -> None:
    with pytest.raises(
        BadData, match="query 'stance' wants data of type float: Expected `float`, got `str`"
    ):
        user.query(STANCE, "wide")  # type: ignore[misc]
    with pytest.raises(BadData, match=r"inform 'position' wants .*Arc.*steps"):
        user.inform(POSITION, Arc(1.0, "many"))  # type: ignore[arg-type]
    assert not [fact for fact in central.facts if isinstance(fact, Received)]


def test_wrong_reply_fails_in_handler(legs: Module, user: Client) -> None:
    @legs.handles(STANCE)
    def narrow_stance(task: Task, radius: float) -> list[int]:
        return ["left"]  # type: ignore[list-item]

    with legs.running(), pytest.raises(QueryFailed) as failed:
        user.query(STANCE, 1.0)
    assert failed.value.failure == "bad data"
    assert "the handler of query 'stance' must return" in failed.value.text
    assert "$[0]" in failed.value.text
    assert "narrow_stance" in failed.value.text


def test_undecodable_data_fails_in_receiver(legs: Module, user: Client) -> None:
    """The formats of both declarations are the same for central, but differ in detail."""

    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        raise AssertionError

    liar = Query("stance", float, reply=list[int])
    liar.data.encode = lambda _: b"\xa4wide"  # type: ignore[method-assign,assignment]
    with (
        legs.running(),
        pytest.raises(
            QueryFailed, match="bad data: query 'stance' came with data that is not of type float"
        ),
    ):
        user.query(liar, 1.0)


def test_conflicting_format_is_refused(legs: Module, user: Client) -> None:
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    with legs.running():
        with pytest.raises(
            FormatRefused, match=r"data \$: integer here, number there .*module 'legs'"
        ):
            user.query(Query("stance", int, reply=list[int]), 1)
        assert user.query(STANCE, 2.0) == [2]


def test_multi_query_reaches_every_handler(central: LocalCentral, user: Client) -> None:
    assert user.multi_query(HEALTH) == []
    modules = [Module(name, central) for name in ("legs", "eyes", "battery")]
    for module in modules:
        module.handles(HEALTH)(lambda _, name=module.name: f"{name} well")
    with modules[0].running(), modules[1].running(), modules[2].running():
        assert sorted(user.multi_query(HEALTH, timeout=SOON)) == [
            "battery well",
            "eyes well",
            "legs well",
        ]
        assert len(user.multi_query(HEALTH, maximum=2, timeout=SOON)) == 2


def test_multi_query_fails_only_if_all_handlers_fail(central: LocalCentral, user: Client) -> None:
    """The error carries the first failure, and names all failures. If one module replies, all
    failures are left out.
    """
    eyes, legs, battery = (Module(name, central) for name in ("eyes", "legs", "battery"))
    blind = Failure("blind", int)

    @eyes.handles(HEALTH)
    @legs.handles(HEALTH)
    def fails(_: Task) -> str:
        raise blind(7, "it is dark")

    battery.handles(HEALTH)(lambda _: "well")
    with eyes.running(), legs.running():
        with pytest.raises(QueryFailed, match="failed: blind: no module replied: ") as found:
            user.multi_query(HEALTH, timeout=SOON)
        assert found.value.data == 7
        assert found.value.text.count("(blind: it is dark)") == 2
        assert "eyes failed" in found.value.text
        assert "legs failed" in found.value.text
        one_by_one = user.multi_query_send(HEALTH, maximum=1, timeout=SOON)
        with pytest.raises(QueryFailed, match="blind"):
            next(one_by_one)
        assert list(one_by_one) == []
        with battery.running():
            assert user.multi_query(HEALTH, timeout=SOON) == ["well"]


def test_multi_query_timeout_names_failed_and_late_modules(
    central: LocalCentral, user: Client
) -> None:
    """An empty list would suggest that no module had a handler."""
    legs, eyes, battery = (Module(name, central) for name in ("legs", "eyes", "battery"))
    release = threading.Event()
    legs.handles(HEALTH)(lambda _: "well" if release.wait(SOON) else "")
    eyes.handles(HEALTH)(lambda _: str(1 / 0))
    battery.handles(HEALTH)(lambda _: str(dict[int, str]()[7]))
    with legs.running(), eyes.running(), battery.running():
        with pytest.raises(QueryFailed) as found:
            user.multi_query(HEALTH, timeout=0.3)
        assert found.value.failure == "handler error"
        text = str(found.value)
        assert text.startswith("multi-query 'health' failed: handler error: no module replied: ")
        assert "eyes failed (handler error: ZeroDivisionError: division by zero)" in text
        assert "battery failed (handler error: KeyError: 7)" in text
        assert text.endswith("; legs has not answered")
        assert "Traceback" in found.value.text  # of the first failure
        one_by_one = user.multi_query_send(HEALTH, timeout=0.3)
        with pytest.raises(QueryFailed, match=r"legs \(queued, busy with health \{"):
            next(one_by_one)
        assert list(one_by_one) == []
        release.set()


# --- Sending a message of any class, and only if it is handled ------------------------------------


@pytest.fixture
def all_legs(central: LocalCentral) -> Module:
    """Return legs that handle a message of each class."""
    legs, received = Module("legs", central), list[Any]()
    legs.handles(REST)(lambda _: None)
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    legs.handles(HEALTH)(lambda _: "well")
    legs.handles(POSITION)(lambda _, arc: received.append(arc))
    legs.handles(ALARM)(lambda _, text: received.append(text))
    return legs


@pytest.mark.parametrize("call", ["execute", "execute_if_handled"])
def test_execute_sends_each_message_class(all_legs: Module, user: Client, call: str) -> None:
    with all_legs.running():
        execute: Any = getattr(user, call)
        goal, command = execute(REST), execute(MOVE_LEG, 3)
        assert isinstance(goal, SentTask)
        assert goal.wait(SOON) is Outcome.DONE
        assert command.result(SOON) == Footfall(3, 0.5)
        assert execute(STANCE, 4.0) == [4]
        assert execute(HEALTH) == ["well"]
        was_sent = None if call == "execute" else True
        assert execute(POSITION, Arc(1.0, 2)) is was_sent
        assert execute(ALARM, "stop") is was_sent


def test_execute_if_handled_sends_no_unhandled_message(user: Client, central: LocalCentral) -> None:
    assert user.execute_if_handled(WALK, Arc(1.0, 2)) is None
    assert user.execute_if_handled(MOVE_LEG, 1) is None
    assert user.execute_if_handled(TEMPERATURE) is None
    assert user.execute_if_handled(HEALTH) is None
    assert user.execute_if_handled(POSITION, Arc(1.0, 2)) is False
    assert user.execute_if_handled(ALARM, "stop") is False
    assert [fact for fact in central.facts if isinstance(fact, Received)] == []
    assert user.goal(REST).id == 1  # unsent messages leave the sibling order unchanged
