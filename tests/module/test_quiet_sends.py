"""Goals, commands and monitors are sent without a wait for central. Refusals by central are raised
later.
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
from module.scripted_central import scripted_connection

from tca_module import (
    CentralLost,
    Client,
    Command,
    Inform,
    Module,
    NotSent,
    Outcome,
    Query,
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


def send_circular(user: Any, **options: Any) -> Any:
    return user.command(STOP, constraints=CIRCLE, **options)


# --- Headers that are sent ------------------------------------------------------------------------


def acknowledge_nothing(header: headers.ToCentral) -> list[headers.ToModule]:
    """Answer as a central that acknowledges no task."""
    if isinstance(header, headers.Hello):
        return [headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "one")]
    return [Accepted(header.number)] if isinstance(header, Register) and header.messages else []


def test_constraint_names_quiet_sends_by_request_number() -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    user = PlainClient(connection)
    first, second = user.command(STOP), user.command(STOP, sequential=False)
    order = first.achieving.end + 0.3 <= second.achieving.start
    user._connection().post(Constrain(0, [order]), b"")
    assert Await not in map(type, central.received)  # nothing needed the tasks' ids
    sends = [header for header in central.received if isinstance(header, Send)]
    assert [(header.number, header.quiet) for header in sends] == [(3, True), (4, True)]
    (constrain,) = [header for header in central.received if isinstance(header, Constrain)]
    assert [(one.before.task, one.after.task) for one in constrain.constraints] == [(-3, -4)]


def test_result_wait_travels_with_command() -> None:
    """Central acknowledges the command together with its answer, so each side sends only two
    packets.
    """
    connection, central = scripted_connection(
        lambda header: (
            [TasksMade([(3, TaskId(17))]), headers.Answer(header.number)]
            if isinstance(header, AwaitPoint)
            else acknowledge_nothing(header)
        )
    )
    PlainClient(connection).command(STOP).result(SOON)
    assert [type(header) for header in central.received] == [Register, Send, AwaitPoint]
    assert central.received[-1].point.task == -3  # type: ignore[union-attr]


def test_reading_task_id_waits_for_central() -> None:
    connection, central = scripted_connection(
        lambda header: (
            [TasksMade([(3, TaskId(17))])]
            if isinstance(header, Await)
            else acknowledge_nothing(header)
        )
    )
    stop = PlainClient(connection).command(STOP)
    assert Await not in map(type, central.received)
    assert stop.id == 17
    assert repr(stop) == "stop {17}"
    assert [header for header in central.received if isinstance(header, Await)] == [Await(3)]


def test_quiet_send_is_repeated_as_plain_send_after_break() -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    user = PlainClient(connection)
    stop = user.command(STOP)
    wait = connection.request(AwaitPoint(0, stop.achieving.end), wants_answer=True)
    central.received.clear()
    central.deliver(headers.Unknown(), headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "one"))
    connection.line.catch_up()
    again = [header for header in central.received if isinstance(header, Send | AwaitPoint)]
    assert [(header.number, type(header)) for header in again] == [(3, Send), (4, AwaitPoint)]
    assert again[0].quiet is False  # type: ignore[union-attr]
    central.deliver(Accepted(3, TaskId(9)), headers.Answer(4))
    connection.line.catch_up()
    assert (stop.id, wait.is_over) == (9, True)


def test_unacknowledged_sends_are_limited() -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    user = PlainClient(connection)
    for _ in range(MAX_UNACKNOWLEDGED):
        user.command(STOP)
    sent = len(central.received)
    with pytest.raises(CentralLost, match="does not answer"):
        user.command(STOP)
    assert len([header for header in central.received[sent:] if isinstance(header, Send)]) == 0
    assert connection.session.sends.unacknowledged == MAX_UNACKNOWLEDGED


def test_task_after_lost_siblings_is_not_sent_to_new_central() -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    user = PlainClient(connection)
    with user.parallel():
        for _ in range(MAX_UNACKNOWLEDGED):
            user.command(STOP)
    central.received.clear()
    news = headers.Unknown(), headers.Welcome(1, headers.PROTOCOL_VERSION, "user", "two")
    central.deliver(*news, at=central.now + 0.1)  # during the wait for earlier acknowledgements
    with pytest.raises(CentralLost, match="command 'stop' is lost: central was restarted"):
        user.command(STOP)
    assert Send not in map(type, central.received)


# --- Refusals -------------------------------------------------------------------------------------


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
    "successor": lambda stop, user: user.goal(
        REST, constraints=[stop.achieving.end <= this.achieving.start]
    ),
    "subtask": lambda stop, user: user.under(stop).command(STOP),
    "variable": lambda _, user: user.set_variable(LEVEL, 1),
    "number": lambda stop, _: int(stop.achieving.end.task),
    "set": lambda stop, _: {stop.achieving.end},
}


@pytest.mark.parametrize("use", USES)
def test_refusal_is_raised_once_by_next_use(central: LocalCentral, use: str) -> None:
    with connect("user", central) as user:
        stop = send_circular(user)
        with pytest.raises(Refused, match=REFUSED) as refused:
            USES[use](stop, user)
        assert refused.value.refusal is Refusal.CYCLE
        assert user.command(STOP).id == 2  # a number is used once


def test_unread_refusal_is_raised_when_client_closes(central: LocalCentral) -> None:
    with pytest.raises(Refused, match=REFUSED), connect("user", central) as user:
        send_circular(user)


def test_block_error_precedes_refusal_at_close(
    central: LocalCentral, caplog: pytest.LogCaptureFixture
) -> None:
    def use() -> None:
        with connect("user", central) as user:
            send_circular(user)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert "command 'stop' was refused" in caplog.text


def test_refusal_is_raised_when_module_ends(central: LocalCentral) -> None:
    with pytest.raises(Refused, match=REFUSED), Module("legs", central).running() as legs:
        send_circular(legs)


def test_further_refusals_are_added_as_notes() -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    user = PlainClient(connection)
    for _ in range(2):
        user.command(STOP)
    central.deliver(
        *(headers.Refused(number, Refusal.CYCLE, f"circle {number}") for number in (3, 4))
    )
    with pytest.raises(Refused, match="command 'stop' was refused: circle 3") as refused:
        user.command(STOP)
    assert refused.value.__notes__ == ["command 'stop' was refused: circle 4"]


@pytest.mark.parametrize("is_async", [False, True], ids=["plain", "async"])
def test_refusal_fails_handler(robot: Robot, user: Client, *, is_async: bool) -> None:
    def rest(task: Task) -> None:
        send_circular(task)

    async def rest_in_time(task: Task) -> None:
        send_circular(task)

    robot.planner.handles(REST)(rest_in_time if is_async else rest)
    with (
        robot.running(),
        pytest.raises(TaskFailed, match=r"handler error: .*command 'stop' was refused") as failed,
    ):
        user.goal(REST).result(SOON)
    assert failed.value.failure == "handler error"


def test_handler_may_catch_refusal_and_continue(robot: Robot, user: Client) -> None:
    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        with pytest.raises(Refused, match=REFUSED):
            send_circular(task).result()
        task.command(MOVE_LEG, 1)

    with robot.running():
        user.goal(REST).result(SOON)
    assert robot.done == ["leg 1"]


def test_late_refusal_still_fails_handler() -> None:
    """Between real processes, the refusal may come after the handler has returned."""
    with RealCentral("tcp://127.0.0.1:*") as central:
        legs = Module("legs", central.address, capacity=3)
        legs.handles(REST)(lambda task: send_circular(task) and None)
        with legs.running(), connect("user", central.address) as user:
            for _ in range(20):
                with pytest.raises(TaskFailed, match="'stop' was refused") as failed:
                    user.goal(REST).result(SOON)
                assert failed.value.failure == "handler error"


@pytest.mark.parametrize("is_heard", [False, True], ids=["after its end", "at its end"])
def test_late_refusal_is_logged_with_handler(
    caplog: pytest.LogCaptureFixture, *, is_heard: bool
) -> None:
    connection, central = scripted_connection(acknowledge_nothing)
    session = connection.session
    session.open_deliveries.begin(9, "rest {1}")
    request = session.send(headers.Send(0, "stop", origin=9), b"", "command 'stop'")
    if not is_heard:
        session.reply(headers.Reply(9), b"")
    central.deliver(headers.Refused(request.header.number, Refusal.CYCLE, "a circle"))
    connection.line.catch_up()
    if is_heard:
        session.reply(headers.Reply(9), b"")
    (line,) = *caplog.messages, *session.complaints
    assert line.startswith(
        "the handler of rest {1} ended before this error: command 'stop' was refused: a circle;"
    )
    assert line.endswith("reading the '.id' of a sent task raises its error in the handler")


@pytest.mark.parametrize("block", ["sequence", "parallel", "none"])
def test_refused_task_leaves_sibling_order_unchanged(
    central: LocalCentral, user: Client, block: str
) -> None:
    def order(*, refused: bool) -> list[list[str]]:
        before = len(central.facts)
        with getattr(user, block)() if block != "none" else user.sequence():
            for number in range(4):
                if refused and number == 2:
                    with pytest.raises(Refused):
                        send_circular(user).id  # noqa: B018
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


def test_successor_of_refused_task_is_not_sent(central: LocalCentral) -> None:
    def use() -> None:
        with connect("user", central) as user, user.sequence():
            user.command(MOVE_LEG, 0)
            send_circular(user)
            user.command(MOVE_LEG, 1)

    with pytest.raises(Refused, match=REFUSED):
        use()
    assert len([fact for fact in central.facts if isinstance(fact, Received)]) == 1


def test_refusal_fails_callback(central: LocalCentral, caplog: pytest.LogCaptureFixture) -> None:
    legs, called = Module("legs", central), threading.Event()

    def stop(callback: Any) -> None:
        send_circular(callback)
        legs.after(0, called.set)

    legs.after(0, stop)
    with legs.running():
        assert called.wait(SOON)
    assert "callback test_refusal_fails_callback.<locals>.stop failed" in caplog.text
    assert "command 'stop' was refused" in caplog.text


# --- Task ids -------------------------------------------------------------------------------------


def test_point_of_just_sent_task_equals_known_point(central: LocalCentral, user: Client) -> None:
    stop, other = user.command(STOP), user.command(STOP)
    points = stop.achieving.end, other.achieving.end
    assert points[0] == stop.achieving.end != points[1]
    assert isinstance(points[0].task, SentId)
    known_point = TaskPoint(TaskId(1), points[0].moment)
    assert points[0] == known_point != points[1]
    assert len({points[0], known_point, points[1]}) == 2
    assert str(points[1]) == "end achieving task 2"
    assert (f"{points[0].task:03d}", 0 < points[0].task <= 1, points[0].task != 1) == (
        "001",
        True,
        False,
    )
    copy = pickle.loads(pickle.dumps(points[0]))
    assert (copy, type(copy.task)) == (points[0], EpochNumber)


def test_point_as_data_carries_task_id(central: LocalCentral, user: Client, legs: Module) -> None:
    asked = Command("asked", Point, result=int)
    legs.handles(asked)(lambda _, point: point.task)
    with legs.running():
        stop = user.command(STOP)
        assert user.command(asked, stop.achieving.end, sequential=False).result(SOON) == 1


def test_other_connection_constrains_just_sent_task(central: LocalCentral, user: Client) -> None:
    with connect("other", central) as other:
        point = user.command(STOP).achieving.end
        assert other.goal(REST, constraints=[point <= this.achieving.start]).id == 2
    (held,) = [
        fact for fact in central.facts if isinstance(fact, Received) and fact.message == "rest"
    ]
    assert [one.before.task for one in held.constraints] == [1]


@pytest.mark.parametrize("is_waiting", [True, False], ids=["waits", "is busy"])
def test_other_thread_constrains_just_sent_task(
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


def test_just_sent_task_is_steered_and_waited_for(robot: Robot, user: Client) -> None:
    robot.planner.handles(REST)(lambda _: None)
    with robot.running():
        held = user.goal(REST, suspended=True)
        assert held.resume()
        assert held.wait(SOON) is Outcome.DONE
        assert user.goal(REST, delay=3600).kill()


def test_task_sent_in_handler_is_its_child(robot: Robot, user: Client) -> None:
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


def test_execute_if_handled_knows_handlers_when_sending(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    assert user.execute_if_handled(STOP) is None
    legs.handles(STOP)(lambda _: None)
    with legs.running():
        sent = user.execute_if_handled(STOP)
        assert sent is not None
        assert sent.result(SOON) is None


# --- Breaks ---------------------------------------------------------------------------------------


def test_connection_break_loses_and_doubles_no_command(robot: Robot, user: Client) -> None:
    with robot.running():
        moves = []
        for number in range(30):
            moves.append(user.command(MOVE_LEG, number))
            if number % 7 == 3:
                robot.central.cut("user")
        assert [move.result(SOON).leg for move in moves] == list(range(30))
    assert sorted(robot.done) == sorted(f"leg {number}" for number in range(30))


def test_unacknowledged_sends_are_counted_in_not_sent(
    central: LocalCentral,
) -> None:
    user = connect("user", central)
    stops = [user.command(STOP), user.command(STOP)]
    central.restart("two")
    with pytest.raises(CentralLost, match="command 'stop' is lost"):
        stops[0].wait()
    with pytest.raises(NotSent, match="1 message of 'user' may not have reached"):
        user.close()


def test_task_given_up_unacknowledged_is_killed(
    central: LocalCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connect("user", central) as user:
        stop = user.command(STOP)
        link = user._connection()
        monkeypatch.setattr(link.transport, "receive", lambda *_: None)
        link.wait_loop.patience = 0.0
        with pytest.raises(
            CentralLost,
            match="command 'stop' is killed as soon as central answers, if central received",
        ):
            stop.result()
        monkeypatch.undo()
        link.wait_loop.patience = SOON
        with pytest.raises(CentralLost, match="command 'stop' is lost: it was given up"):
            stop.result()
        user.modules()
    assert [fact.task for fact in central.facts if isinstance(fact, Killed)] == [1]


def test_killed_handler_gets_task_killed_in_wait(robot: Robot, user: Client) -> None:
    reasons = queue.SimpleQueue[str]()

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        try:
            task.command(Command("never")).result()
        except TaskKilled as error:
            reasons.put(str(error))
            raise

    with robot.running():
        resting = user.goal(REST)
        assert resting.wait_for(resting.handling.start, SOON)
        resting.kill()
        assert reasons.get(timeout=SOON).startswith("rest {1} was killed")
        assert resting.wait(SOON) is Outcome.KILLED


def test_central_acknowledges_last_sends_soon(tmp_path: Path) -> None:
    """Otherwise a restart would leave old sends in doubt."""
    with (
        RealCentral(f"ipc://{tmp_path}/central.sock") as central,
        connect("user", central.address) as user,
    ):
        user.command(STOP)
        link = user._connection()

        def is_told() -> bool:
            link.line.catch_up()
            return not link.session.sends.unacknowledged

        until(is_told, "central has acknowledged the task")


# --- Packet counts --------------------------------------------------------------------------------


class CountingCentral(LocalCentral):
    """A central that counts the packets to and from it."""

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
def test_packet_counts_match_protocol(use: Callable[[Client], None], there: int, back: int) -> None:
    """These numbers are also in docs/reference/protocol.md."""
    with CountingCentral() as central:
        legs, planner = Module("legs", central), Module("planner", central)
        legs.handles(ASK)(lambda _: 1)
        legs.handles(STOP)(lambda _: None)

        @planner.handles(STEP)
        def step(task: Task, number: int) -> None:
            for _ in range(number):
                task.command(STOP)

        with legs.running(), planner.running(), connect("user", central) as user:
            use(user)  # declares all messages
            before = central.there, central.back
            use(user)
            user.status()  # all packets have been sent
            assert (central.there - before[0] - 1, central.back - before[1] - 1) == (there, back)
