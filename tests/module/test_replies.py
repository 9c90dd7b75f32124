"""Replies that call a function, and replies of many that are fetched one by one."""

import queue
import threading
from collections.abc import Callable

import pytest
from module.gait_messages import COLLISION, HEALTH, MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall
from module.test_connection import ScriptedCentral, connected  # a scripted central, and a clock of its own

from tca_module import CentralLost, Client, MisuseError, Module, QueryFailed, Sender, Task, Timeout
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Dropped, Received
from tca_wire.packets.headers import Beat

SOON = 5.0


def test_what_it_is_called_with_sends(legs: Module, user: Client) -> None:
    moved: list[Footfall] = []
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))

    def move(sender: Sender, stance: list[int]) -> None:
        moved.append(sender.command(MOVE_LEG, stance[0]).result(SOON))

    with legs.running():
        assert user.query_notify(STANCE, 3.0, move).wait(SOON)
        assert legs.query_notify(STANCE, 4.0, move).wait(SOON)
    assert [foot.leg for foot in moved] == [3, 4]


def test_a_handler_need_not_stay_for_it(legs: Module, eyes: Module, user: Client, central: LocalCentral) -> None:
    """The function is called in the handler's thread, and sends under the root."""
    moved, returned = queue.Queue[str](), threading.Event()
    eyes.handles(STANCE)(lambda _, radius: [int(radius)] if returned.wait(SOON) else [])
    eyes.handles(MOVE_LEG, resource="other")(lambda _, leg: Footfall(leg, 0.0))

    @legs.handles(REST)
    def rest(task: Task) -> None:
        def move(sender: Sender, stance: list[int]) -> None:
            with pytest.raises(MisuseError, match="is used after its handler returned"):
                task.command(MOVE_LEG, 1)
            sender.command(MOVE_LEG, stance[0]).result(SOON)
            moved.put(threading.current_thread().name)

        task.query_notify(STANCE, 3.0, move)

    with legs.running(), eyes.running():
        user.goal(REST).result(SOON)
        returned.set()
        assert moved.get(timeout=SOON) == "legs 1"
    sent = [fact for fact in central.facts if isinstance(fact, Received) and fact.message == "move leg"]
    assert [(fact.parent, fact.sender) for fact in sent] == [(0, "legs")]


def test_failures_are_told_or_logged(legs: Module, user: Client, caplog: pytest.LogCaptureFixture) -> None:
    failures: list[Exception] = []

    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        raise COLLISION(Footfall(1, radius), "rock")

    with legs.running():
        never: list[object] = []
        told = user.query_notify(STANCE, 3.0, lambda *_: never.append(1), lambda _, error: failures.append(error))
        assert told.wait(SOON)
        assert not caplog.records
        assert user.query_notify(STANCE, 3.0, lambda *_: never.append(1)).wait(SOON)
    assert not never
    assert isinstance(failures[0], QueryFailed)
    assert failures[0].data_as(COLLISION) == Footfall(1, 3.0)
    assert "QueryFailed: query 'stance' failed: collision: rock" in caplog.text


def test_an_error_in_a_function_is_logged(legs: Module, user: Client, caplog: pytest.LogCaptureFixture) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)

    def fails(sender: Sender, degrees: float) -> None:
        raise SystemExit(int(degrees))

    with legs.running():
        note = user.query_notify(TEMPERATURE, None, fails)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
        assert note.wait(SOON)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert "callback test_an_error_in_a_function_is_logged.<locals>.fails failed" in caplog.text
    assert "SystemExit: 36" in caplog.text


def test_functions_are_called_one_after_the_other_however_many(legs: Module, user: Client) -> None:
    """They would nest if one that waits let others be called meanwhile."""
    depth, deepest, count = 0, 0, 300

    def ask(sender: Sender, degrees: float) -> None:
        nonlocal depth, deepest
        depth += 1
        deepest = max(deepest, depth)
        assert sender.query(TEMPERATURE, timeout=SOON) == degrees
        depth -= 1

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        notes = [user.query_notify(TEMPERATURE, None, ask) for _ in range(count)]
        assert all(note.wait(SOON) for note in notes)
    assert deepest == 1


def test_one_function_does_not_wait_for_another(legs: Module, user: Client) -> None:
    caught: list[BaseException] = []

    def waits(sender: Sender, degrees: float) -> None:
        note = sender.query_notify(TEMPERATURE, None, lambda *_: None)
        with pytest.raises(MisuseError, match="a callback waits for another one") as error:
            note.wait(SOON)
        caught.append(error.value)

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query_notify(TEMPERATURE, None, waits).wait(SOON)
    assert len(caught) == 1


def test_a_query_that_was_given_up_calls_nothing(legs: Module, user: Client, central: LocalCentral) -> None:
    called: list[float] = []
    note = user.query_notify(TEMPERATURE, None, lambda _, degrees: called.append(degrees))
    assert not note.wait(0.0)
    note.cancel()
    note.cancel()
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert not called
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == ["no module handles it"]


def test_a_reply_that_is_there_when_it_is_given_up_calls_nothing(legs: Module, user: Client) -> None:
    called: list[int] = []
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        first = user.query_notify(TEMPERATURE, None, lambda *_: second.cancel())
        second = user.query_notify(TEMPERATURE, None, lambda *_: called.append(2))
        assert first.wait(SOON)
        user.query(TEMPERATURE, timeout=SOON)
    assert not called


def test_a_reply_that_is_lost_is_a_failure(legs: Module, user: Client, central: LocalCentral) -> None:
    failures: list[Exception] = []
    note = user.query_notify(TEMPERATURE, None, lambda *_: None, lambda _, error: failures.append(error))
    central.restart("afresh")
    assert note.wait(SOON)
    assert isinstance(failures[0], CentralLost)


def test_replies_of_many_come_one_by_one(central: LocalCentral, user: Client) -> None:
    names = ["legs", "eyes", "battery"]
    modules = [Module(name, central) for name in names]
    turns = {name: threading.Event() for name in names}
    for name, module in zip(names, modules, strict=True):
        module.handles(HEALTH)(lambda _, name=name: name if turns[name].wait(SOON) else "late")
    with modules[0].running(), modules[1].running(), modules[2].running():
        replies = user.multi_query_send(HEALTH, timeout=SOON)
        for name in ("eyes", "battery", "legs"):
            turns[name].set()
            assert next(replies) == name
        assert list(replies) == []
        first, second = user.multi_query_send(HEALTH, maximum=2, timeout=SOON)
        assert first != second
        assert len(list(user.multi_query_send(HEALTH, maximum=9, timeout=None))) == 3


def test_what_is_not_fetched_is_given_up(legs: Module, user: Client, central: LocalCentral) -> None:
    go = threading.Event()
    legs.handles(HEALTH)(lambda _: "well" if go.wait(SOON) else "late")
    with legs.running():
        replies = user.multi_query_send(HEALTH, timeout=0.01)
        assert list(replies) == []
        assert list(replies) == []
        again = user.multi_query_send(HEALTH)
        again.cancel()
        again.cancel()
        assert list(again) == []
        go.set()
        assert user.multi_query(HEALTH, timeout=SOON) == ["well"]
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == [
        "nobody replied: legs has not answered",
        "nobody replied: legs (queued, busy with health {1}) has not answered",
    ]


def test_central_that_beats_and_does_not_answer(legs: Module) -> None:
    connection, central = connected()
    keep_beating(central)
    with pytest.raises(Timeout, match=r"the question for tree was not answered within 30 s, though central is alive"):
        Client(connection).status("tree")
    assert 130 <= central.now <= 131


def keep_beating(central: ScriptedCentral) -> None:
    for second in range(60):
        central.say(Beat(), at=central.now + second)


def test_a_handlers_task_is_for_its_thread(legs: Module, user: Client) -> None:
    """The thread that serves holds the connection: others must not wait for it for ever."""
    caught = queue.Queue[str]()

    def elsewhere(task: Task) -> None:
        calls: list[Callable[[], object]] = [lambda: task.query(TEMPERATURE), lambda: task.cancelled]
        for call in calls:
            try:
                call()
            except MisuseError as error:
                caught.put(str(error))

    @legs.handles(REST)
    def rest(task: Task) -> None:
        thread = threading.Thread(target=elsewhere, args=(task,))
        thread.start()
        thread.join(SOON)

    with legs.running():
        user.goal(REST).result(SOON)
    for _ in range(2):
        assert "belongs to the one that opened it" in caught.get(timeout=SOON)
