"""Goals, commands and monitors are sent without waiting for central's word; what it refuses is
raised all the same.
"""

import pickle
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, until
from module.robot import MOVE_LEG, REST, STEP, STOP, WALK, Arc, Robot
from module.test_connection import connected

from tca_module import (
    CentralLost,
    Client,
    Command,
    Inform,
    Module,
    NotSent,
    Outcome,
    Query,
    QueryFailed,
    Refused,
    Task,
    TaskFailed,
    TaskKilled,
    Variable,
    connect,
    this,
)
from tca_module.client import Client as PlainClient
from tca_module.link.connection import MAX_UNACKNOWLEDGED
from tca_module.sending.task_points import TaskPoint
from tca_module.session.epoch_numbers import EpochNumber
from tca_module.session.sent_tasks import SentId
from tca_module.testing import LocalCentral, LocalTransport
from tca_wire.journal.facts import Killed, Received
from tca_wire.packets import headers
from tca_wire.packets.headers import (
    Accepted,
    Await,
    AwaitPoint,
    Constrain,
    Register,
    Send,
    TasksMade,
)
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Refusal

NOTE, ASK, LEVEL = Inform("note", str), Query("ask", reply=int), Variable("level", int)
CIRCLE = [this.achieving.end <= this.achieving.start]
REFUSED = r"command 'stop' was refused: .* would be a cycle"


def circle(user: Any, **options: Any) -> Any:
    return user.command(STOP, constraints=CIRCLE, **options)


# --- what travels ---------------------------------------------------------------------------------


def silent(header: headers.ToCentral) -> list[headers.ToModule]:
    """A central that says nothing of what is sent."""
    if isinstance(header, headers.Hello):
        return [headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "one")]
    return [Accepted(header.number)] if isinstance(header, Register) and header.messages else []


def test_nobody_waits_and_what_follows_names_the_request() -> None:
    connection, central = connected(silent)
    user = PlainClient(connection)
    first, second = user.command(STOP), user.command(STOP, sequential=False)
    user._connection().post(Constrain(0, [first.achieving.end <= second.achieving.start]), b"")
    sends = [header for header in central.heard if isinstance(header, Send)]
    assert [(header.number, header.quiet) for header in sends] == [(3, True), (4, True)]
    (constrain,) = [header for header in central.heard if isinstance(header, Constrain)]
    assert [(one.before.task, one.after.task) for one in constrain.constraints] == [(-3, -4)]


def test_the_wait_for_a_result_travels_with_the_command() -> None:
    """Two packets there, none in between: central's word of the command comes with the answer."""
    connection, central = connected(
        lambda header: (
            [TasksMade([(3, TaskId(17))]), headers.Answer(header.number)]
            if isinstance(header, AwaitPoint)
            else silent(header)
        )
    )
    PlainClient(connection).command(STOP).result(SOON)
    assert [type(header) for header in central.heard] == [Register, Send, AwaitPoint]
    assert central.heard[-1].point.task == -3  # type: ignore[union-attr]


def test_who_looks_at_the_id_waits_for_it() -> None:
    connection, central = connected(
        lambda header: (
            [TasksMade([(3, TaskId(17))])] if isinstance(header, Await) else silent(header)
        )
    )
    stop = PlainClient(connection).command(STOP)
    assert Await not in map(type, central.heard)
    assert stop.id == 17
    assert repr(stop) == "stop {17}"
    assert [header for header in central.heard if isinstance(header, Await)] == [Await(3)]


def test_after_a_break_it_is_said_again_and_answered_by_itself() -> None:
    connection, central = connected(silent)
    user = PlainClient(connection)
    stop = user.command(STOP)
    wait = connection.request(AwaitPoint(0, stop.achieving.end), wants_answer=True)
    central.heard.clear()
    central.say(headers.Unknown(), headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "one"))
    connection.line.catch_up()
    again = [header for header in central.heard if isinstance(header, Send | AwaitPoint)]
    assert [(header.number, type(header)) for header in again] == [(3, Send), (4, AwaitPoint)]
    assert again[0].quiet is False  # type: ignore[union-attr]
    central.say(Accepted(3, TaskId(9)), headers.Answer(4))
    connection.line.catch_up()
    assert (stop.id, wait.is_over) == (9, True)


def test_a_hundred_tasks_are_on_their_way_at_most() -> None:
    connection, central = connected(silent)
    user = PlainClient(connection)
    for _ in range(MAX_UNACKNOWLEDGED):
        user.command(STOP)
    sent = len(central.heard)
    with pytest.raises(CentralLost, match="does not answer"):
        user.command(STOP)
    assert len([header for header in central.heard[sent:] if isinstance(header, Send)]) == 0
    assert connection.session.sends.unacknowledged == MAX_UNACKNOWLEDGED


def test_what_was_to_follow_those_of_the_central_before_is_not_sent_to_the_next() -> None:
    connection, central = connected(silent)
    user = PlainClient(connection)
    with user.parallel():
        for _ in range(MAX_UNACKNOWLEDGED):
            user.command(STOP)
    central.heard.clear()
    news = headers.Unknown(), headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "two")
    central.say(*news, at=central.now + 0.1)  # while it waits, for so many are on their way
    with pytest.raises(CentralLost, match="command 'stop' is lost: central was restarted"):
        user.command(STOP)
    assert Send not in map(type, central.heard)


# --- refusals -------------------------------------------------------------------------------------


USES: dict[str, Callable[[Any, Client], object]] = {
    "id": lambda stop, _: stop.id,
    "repr": lambda stop, _: repr(stop),
    "result": lambda stop, _: stop.result(SOON),
    "wait": lambda stop, _: stop.wait(SOON),
    "info": lambda stop, _: stop.info(),
    "keep": lambda stop, _: stop.keep(),
    "next send": lambda _, user: user.command(STOP),
    "next inform": lambda _, user: user.inform(NOTE, "on"),
    "next question": lambda _, user: user.query(ASK),
    "constrain": lambda stop, user: user.constrain(stop.achieving.end <= stop.handling.start),
    "what comes after": lambda stop, user: user.goal(
        REST, constraints=[stop.achieving.end <= this.achieving.start]
    ),
    "what is under it": lambda stop, user: user.under(stop).command(STOP),
    "variable": lambda _, user: user.set_variable(LEVEL, 1),
    "a number": lambda stop, _: int(stop.achieving.end.task),
    "a set": lambda stop, _: {stop.achieving.end},
}


@pytest.mark.parametrize("use", USES)
def test_a_refusal_is_raised_by_the_next_use_and_once(central: LocalCentral, use: str) -> None:
    with connect("user", central) as user:
        stop = circle(user)
        with pytest.raises(Refused, match=REFUSED) as refused:
            USES[use](stop, user)
        assert refused.value.refusal is Refusal.CYCLE
        assert user.command(STOP).id == 2  # a number is used once


def test_a_refusal_of_which_nobody_asks_is_raised_at_the_end(central: LocalCentral) -> None:
    with pytest.raises(Refused, match=REFUSED), connect("user", central) as user:
        circle(user)


def test_at_the_end_the_error_of_the_block_comes_first(
    central: LocalCentral, caplog: pytest.LogCaptureFixture
) -> None:
    def use() -> None:
        with connect("user", central) as user:
            circle(user)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert "command 'stop' was refused" in caplog.text


def test_the_end_of_a_running_module_raises_it(central: LocalCentral) -> None:
    with pytest.raises(Refused, match=REFUSED), Module("legs", central).running() as legs:
        circle(legs)


def test_what_else_was_refused_is_noted() -> None:
    connection, central = connected(silent)
    user = PlainClient(connection)
    for _ in range(2):
        user.command(STOP)
    central.say(*(headers.Refused(number, Refusal.CYCLE, f"circle {number}") for number in (3, 4)))
    with pytest.raises(Refused, match="command 'stop' was refused: circle 3") as refused:
        user.command(STOP)
    assert refused.value.__notes__ == ["command 'stop' was refused: circle 4"]


@pytest.mark.parametrize("is_async", [False, True], ids=["plain", "async"])
def test_a_handler_fails_with_it(robot: Robot, user: Client, *, is_async: bool) -> None:
    def rest(task: Task) -> None:
        circle(task)

    async def rest_in_time(task: Task) -> None:
        circle(task)

    robot.planner.handles(REST)(rest_in_time if is_async else rest)
    with (
        robot.running(),
        pytest.raises(TaskFailed, match=r"handler error: .*command 'stop' was refused") as failed,
    ):
        user.goal(REST).result(SOON)
    assert failed.value.failure == "handler error"


def test_a_handler_may_catch_it_and_go_on(robot: Robot, user: Client) -> None:
    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        with pytest.raises(Refused, match=REFUSED):
            circle(task).result()
        task.command(MOVE_LEG, 1)

    with robot.running():
        user.goal(REST).result(SOON)
    assert robot.done == ["leg 1"]


def test_a_handler_that_has_not_heard_of_it_has_failed_all_the_same() -> None:
    """In real processes the refusal may come after the handler has returned."""
    with RealCentral("tcp://127.0.0.1:*") as central:
        legs = Module("legs", central.address, capacity=3)
        legs.handles(REST)(lambda task: circle(task) and None)
        with legs.running(), connect("user", central.address) as user:
            for _ in range(20):
                with pytest.raises(TaskFailed, match="'stop' was refused") as failed:
                    user.goal(REST).result(SOON)
                assert failed.value.failure == "handler error"


@pytest.mark.parametrize("is_heard", [False, True], ids=["after its end", "at its end"])
def test_the_log_names_the_handler_that_has_not_heard_of_it(
    caplog: pytest.LogCaptureFixture, *, is_heard: bool
) -> None:
    connection, central = connected(silent)
    session = connection.session
    session.open_deliveries.begin(9, "rest {1}")
    request = session.send(headers.Send(0, "stop", origin=9), b"", "command 'stop'")
    if not is_heard:
        session.reply(headers.Reply(9), b"")
    central.say(headers.Refused(request.header.number, Refusal.CYCLE, "a circle"))
    connection.line.catch_up()
    if is_heard:
        session.reply(headers.Reply(9), b"")
    (line,) = *caplog.messages, *session.complaints
    assert line.startswith(
        "the handler of rest {1} ended before this error: command 'stop' was refused: a circle;"
    )
    assert line.endswith("reading the '.id' of a sent task raises its error in the handler")


@pytest.mark.parametrize("block", ["sequence", "parallel", "none"])
def test_what_was_refused_is_as_if_it_had_never_been_sent(
    central: LocalCentral, user: Client, block: str
) -> None:
    def order(*, refused: bool) -> list[list[str]]:
        before = len(central.facts)
        with getattr(user, block)() if block != "none" else user.sequence():
            for number in range(4):
                if refused and number == 2:
                    with pytest.raises(Refused):
                        circle(user).id  # noqa: B018
                user.command(MOVE_LEG, number)
        user.command(MOVE_LEG, 9)
        sent = [fact for fact in central.facts[before:] if isinstance(fact, Received)]
        places = {fact.id: str(number) for number, fact in enumerate(sent)}
        for fact in sent:
            user.task(fact.id).kill()  # type: ignore[union-attr]
        return [
            [
                f"{one.before.moment} {places.get(one.before.task, 'before')} {one.after.moment}"
                for one in fact.constraints
            ]
            for fact in sent
        ]

    assert order(refused=True) == order(refused=False)


def test_what_follows_one_that_is_refused_is_not_sent(central: LocalCentral) -> None:
    def use() -> None:
        with connect("user", central) as user, user.sequence():
            user.command(MOVE_LEG, 0)
            circle(user)
            user.command(MOVE_LEG, 1)

    with pytest.raises(Refused, match=REFUSED):
        use()
    assert len([fact for fact in central.facts if isinstance(fact, Received)]) == 1


def test_a_callback_fails_with_it(central: LocalCentral, caplog: pytest.LogCaptureFixture) -> None:
    legs, called = Module("legs", central), threading.Event()

    def stop(callback: Any) -> None:
        circle(callback)
        legs.after(0, called.set)

    legs.after(0, stop)
    with legs.running():
        assert called.wait(SOON)
    assert "callback test_a_callback_fails_with_it.<locals>.stop failed" in caplog.text
    assert "command 'stop' was refused" in caplog.text


def test_the_handler_of_a_direct_message_fails_with_it() -> None:
    with RealCentral("tcp://127.0.0.1:*") as central:
        legs = Module("legs", central.address)
        legs.handles(ASK, direct=True)(lambda task: circle(task) and 1)
        with legs.running(), connect("user", central.address) as user:
            for _ in range(5):
                with pytest.raises(QueryFailed, match="'stop' was refused"):
                    user.query(ASK)


# --- ids ------------------------------------------------------------------------------------------


def test_a_point_of_a_task_that_was_just_sent_is_like_any_other(
    central: LocalCentral, user: Client
) -> None:
    stop, other = user.command(STOP), user.command(STOP)
    points = stop.achieving.end, other.achieving.end
    assert points[0] == stop.achieving.end != points[1]
    assert isinstance(points[0].task, SentId)
    known = TaskPoint(TaskId(1), points[0].moment)
    assert points[0] == known != points[1]
    assert len({points[0], known, points[1]}) == 2
    assert str(points[1]) == "end achieving task 2"
    assert (f"{points[0].task:03d}", 0 < points[0].task <= 1, points[0].task != 1) == (
        "001",
        True,
        False,
    )
    copy = pickle.loads(pickle.dumps(points[0]))
    assert (copy, type(copy.task)) == (points[0], EpochNumber)


def test_as_data_a_point_has_its_id(central: LocalCentral, user: Client, legs: Module) -> None:
    asked = Command("asked", Point, result=int)
    legs.handles(asked)(lambda _, point: point.task)
    with legs.running():
        stop = user.command(STOP)
        assert user.command(asked, stop.achieving.end, sequential=False).result(SOON) == 1


def test_another_connection_names_it_by_its_id(central: LocalCentral, user: Client) -> None:
    with connect("other", central) as other:
        point = user.command(STOP).achieving.end
        assert other.goal(REST, constraints=[point <= this.achieving.start]).id == 2
    (held,) = [
        fact for fact in central.facts if isinstance(fact, Received) and fact.message == "rest"
    ]
    assert [one.before.task for one in held.constraints] == [1]


@pytest.mark.parametrize("is_waiting", [True, False], ids=["waits", "is busy"])
def test_another_thread_names_it_by_its_id(
    central: LocalCentral, user: Client, *, is_waiting: bool
) -> None:
    point, sent, done = (
        user.command(STOP).achieving.end,
        queue.SimpleQueue[int](),
        threading.Event(),
    )

    def use() -> None:
        with connect("other", central) as other:
            sent.put(other.goal(REST, constraints=[point <= this.achieving.start]).id)
        done.set()

    thread = threading.Thread(target=use)
    thread.start()
    if is_waiting:
        user.wait_until_handled(timeout=0.5)
        assert user._connection().listen(done.is_set, SOON)
    assert sent.get(timeout=SOON) == 2
    thread.join()


def test_a_task_sent_just_now_is_steered_and_watched(robot: Robot, user: Client) -> None:
    robot.planner.handles(REST)(lambda _: None)
    with robot.running():
        held = user.goal(REST, suspended=True)
        assert held.resume()
        assert held.wait(SOON) is Outcome.DONE
        assert user.goal(REST, delay=3600).kill()


def test_in_a_handler_it_hangs_under_the_handlers_task(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        steps = [task.goal(STEP, number) for number in range(arc.steps)]
        task.under(steps[0]).command(MOVE_LEG, 0)

    @robot.planner.handles(STEP)
    def step(task: Task, number: int) -> None:
        task.command(MOVE_LEG, number)

    with robot.running():
        user.goal(WALK, Arc(1.0, 3)).result(SOON)
    (walked,) = robot.received("walk")
    steps = robot.received("step")
    assert [step.parent for step in steps] == [walked.id] * 3
    assert sorted(move.parent for move in robot.received("move leg")) == sorted(
        [steps[0].id, *(one.id for one in steps)]
    )


def test_whether_it_is_handled_is_known_when_it_is_sent(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    assert user.execute_if_handled(STOP) is None
    legs.handles(STOP)(lambda _: None)
    with legs.running():
        sent = user.execute_if_handled(STOP)
        assert sent is not None
        assert sent.result(SOON) is None


# --- breaks ---------------------------------------------------------------------------------------


def test_a_break_in_between_loses_and_doubles_nothing(robot: Robot, user: Client) -> None:
    with robot.running():
        moves = []
        for number in range(30):
            moves.append(user.command(MOVE_LEG, number))
            if number % 7 == 3:
                robot.central.cut("user")
        assert [move.result(SOON).leg for move in moves] == list(range(30))
    assert sorted(robot.done) == sorted(f"leg {number}" for number in range(30))


def test_what_central_may_not_have_got_is_counted_unless_its_sender_knows(
    central: LocalCentral,
) -> None:
    user = connect("user", central)
    stops = [user.command(STOP), user.command(STOP)]
    central.restart("two")
    with pytest.raises(CentralLost, match="command 'stop' is lost"):
        stops[0].wait()
    with pytest.raises(NotSent, match="1 message of 'user' may not have reached"):
        user.close()


def test_a_task_that_is_given_up_unheard_is_called_back(
    central: LocalCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connect("user", central) as user:
        stop = user.command(STOP)
        link = user._connection()
        monkeypatch.setattr(link.transport, "receive", lambda *_: None)
        link.waiting.patience = 0.0
        with pytest.raises(
            CentralLost,
            match="command 'stop' is killed as soon as central answers, if central received",
        ):
            stop.result()
        monkeypatch.undo()
        link.waiting.patience = SOON
        with pytest.raises(CentralLost, match="command 'stop' is lost: it was given up"):
            stop.result()
        user.modules()
    assert [fact.task for fact in central.facts if isinstance(fact, Killed)] == [1]


def test_a_killed_handler_is_told_as_ever(robot: Robot, user: Client) -> None:
    told = queue.SimpleQueue[str]()

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        try:
            task.command(Command("never")).result()
        except TaskKilled as error:
            told.put(str(error))
            raise

    with robot.running():
        resting = user.goal(REST)
        assert resting.wait_for(resting.handling.start, SOON)
        resting.kill()
        assert told.get(timeout=SOON).startswith("rest {1} was killed")
        assert resting.wait(SOON) is Outcome.KILLED


def test_central_tells_of_the_last_ones_soon(tmp_path: Path) -> None:
    """Else a restart would leave them in doubt, however long ago they were sent."""
    with (
        RealCentral(f"ipc://{tmp_path}/central.sock") as central,
        connect("user", central.address) as user,
    ):
        user.command(STOP)
        link = user._connection()

        def is_told() -> bool:
            link.line.catch_up()
            return not link.session.sends.unacknowledged

        until(is_told, "central has told the id")


# --- packets --------------------------------------------------------------------------------------


class Counted(LocalCentral):
    """Counts the packets that go to central and come from it."""

    there = back = 0

    def submit(self, connection: Any, packet: bytes) -> bool:
        self.there += 1
        return super().submit(connection, packet)

    def transport(self) -> LocalTransport:
        transport = super().transport()
        arrive = transport.arrive

        def counting(packet: bytes) -> None:
            self.back += bool(packet)
            arrive(packet)

        transport.arrive = counting  # type: ignore[method-assign]
        return transport


def use_query(user: Client) -> None:
    user.query(ASK)


def use_command(user: Client) -> None:
    user.command(STOP).result(SOON)


def use_goal(user: Client) -> None:
    user.goal(STEP, 10).result(SOON)


@pytest.mark.parametrize(
    ("use", "there", "back"),
    [(use_query, 2, 2), (use_command, 3, 2), (use_goal, 3 + 2 * 10, 2 + 10)],
)
def test_nothing_travels_that_nobody_needs(
    use: Callable[[Client], None], there: int, back: int
) -> None:
    """As docs/protocol.md has it."""
    with Counted() as central:
        legs, planner = Module("legs", central), Module("planner", central)
        legs.handles(ASK)(lambda _: 1)
        legs.handles(STOP)(lambda _: None)

        @planner.handles(STEP)
        def step(task: Task, number: int) -> None:
            for _ in range(number):
                task.command(STOP)

        with legs.running(), planner.running(), connect("user", central) as user:
            use(user)  # all is declared, then
            before = central.there, central.back
            use(user)
            user.status()  # all has been said
            assert (central.there - before[0] - 1, central.back - before[1] - 1) == (there, back)
