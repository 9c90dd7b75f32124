"""Single requests at the edges: kills of what is suspended or was never heard of, lines that break, notices, odd times."""

from collections.abc import Callable

import pytest
from central.player import ANY, Player, point

from tca_central.events import Tick
from tca_wire.journal import facts
from tca_wire.journal.facts import Ignored, RequestRefused
from tca_wire.messages.notices import MODULE_LEFT, NOTICES
from tca_wire.packets import headers
from tca_wire.packets.headers import PROTOCOL_VERSION, Accepted, Kill, Refused, Register
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Due, MessageClass, Outcome, Refusal


def test_what_is_to_be_done_on_termination_is_done_also_under_what_was_killed_before_it_was_suspended() -> None:
    robot = Player()
    robot.module("planner", "goal walk", capacity=2)
    robot.module("legs", "command stop")
    robot.module("user")
    busy = robot.task("user", "stop", flags=0)
    above = robot.task("user", "walk", flags=0)
    below = robot.task("planner/1", "walk", under=above)
    robot.send("planner/2", "stop", under=below, when_killed=True)
    for header, task in ((headers.Kill, below), (headers.Suspend, above), (headers.Kill, above)):
        robot.receive("user", header(robot.number("user"), TaskId(task)))
    robot.reply("legs/1", busy)
    assert not any(task.suspended for task in robot.central.tree.tasks.values())
    assert robot.delivered("legs/1")  # it stops


@pytest.mark.parametrize("began", [6.3, 8.7, 12345.6])
@pytest.mark.parametrize("period", [0.1, 0.02, 1 / 3])
def test_a_monitor_tests_once_a_period_and_never_twice_at_once(began: float, period: float) -> None:
    """To a computer 0.6 - 0.3 is less than 3 * 0.1: the next test was due at once, again and again, for ever."""
    player = Player.of("eye: query seen", "user")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, "", parts=["seen", ""])
    player.receive("user", Register(player.number("user"), [watch]))
    player.time = began - 1
    player.send("user", "watch", watch=WatchOptions(period=period))
    for number in range(1, 30):
        (test,) = (timer for timer in player.central.clock.pending() if timer.due is Due.TEST)
        assert test.time == pytest.approx(began + number * period)
        player.event(Tick(test.time))


BACK = headers.Hello(1, PROTOCOL_VERSION, "legs", "run of legs", 1, "legs", "here:1")


@pytest.mark.parametrize(("steer", "why"), [(headers.Kill, "by user"), (headers.Retry, "it is to be handled again")])
def test_a_handler_is_told_again_that_it_is_to_end(steer: type, why: str) -> None:
    robot = Player.of("legs: command step", "user")
    step = robot.task("user", "step")
    said = robot.receive("new line", BACK)
    assert headers.Deliver(step, "step", TaskId(step)) in said
    assert headers.Cancelled(step, why) not in said
    robot.receive("user", steer(robot.number("user"), TaskId(step)))
    assert headers.Cancelled(step, why) in robot.receive("newer line", BACK)


@pytest.mark.parametrize("answer", [headers.Reply, lambda delivery: headers.Fail(delivery, "slipped")])
def test_who_comes_back_after_its_loss_is_told_why_its_answer_is_too_late(
    answer: Callable[[int], headers.Reply | headers.Fail],
) -> None:
    """It could not know: nothing is refused, and no number is told that says nothing to anybody."""
    robot = Player.of("legs: command step", "user")
    step = robot.task("user", "step")
    robot.lose("legs/1")
    assert headers.Cancelled(step, "its connection to central was lost") in robot.receive("new line", BACK)
    late = f"the answer of task {step} 'step' came too late: the module had been lost (its connection closed)"
    assert robot.receive("new line", answer(step)) == [headers.Refused(0, Refusal.TOO_LATE, late)]
    assert robot.facts(Ignored) == [Ignored("legs", late)]
    assert robot.facts(RequestRefused) == []


def test_who_asks_after_the_end_is_told_of_a_resolved_failure() -> None:
    """As who has waited since before the end."""
    robot = Player.of("legs: command step", "expert: exception handler shrug", "user")
    robot.receive("user", headers.Attach(robot.number("user"), Attachment("", "shrug")))
    step = robot.task("user", "step")
    early = robot.number("user")
    robot.receive("user", headers.AwaitPoint(early, point(step, Moment.END_ACHIEVING)))
    robot.fail("legs/1", "stuck")
    robot.resolve("expert/1")
    answers = [answer for answer in robot.reply("expert/1") if isinstance(answer, headers.Answer)]
    assert answers == [headers.Answer(early, Outcome.RESOLVED, "stuck", "why")]
    late = robot.number("user")
    answers = robot.receive("user", headers.AwaitPoint(late, point(step, Moment.END_ACHIEVING)))
    assert answers == [headers.Answer(late, Outcome.RESOLVED, "stuck", "why")]


def recall(player: Player, request: int) -> list[int]:
    """What central says was killed."""
    number = player.number("user")
    answers = player.receive("user", Kill(number, TaskId(-request), "given up"))
    return [answer.id for answer in answers if isinstance(answer, Accepted) and answer.number == number]


def test_what_came_is_killed_with_all_under_it() -> None:
    player = Player.of("legs: goal walk", "user")
    walk = player.task("user", "walk")
    sent_with = player.numbers["user"]
    player.task("user", "walk")
    step = player.task("legs/1", "walk", under=walk)
    assert recall(player, sent_with) == [walk]
    killed = player.facts(facts.Killed)
    assert [(fact.task, fact.why) for fact in killed] == [(walk, "given up"), (step, "given up")]


def test_what_has_not_come_never_will() -> None:
    """A request that arrives after the one with a higher number is answered, and not done."""
    player = Player.of("legs: goal walk", "user")
    lost = player.number("user")
    assert recall(player, lost) == [0]
    assert not [one for one in player.send("user", "walk", number=lost) if isinstance(one, Accepted)]
    assert list(player.central.tree.tasks) in ([], [ROOT])


def test_what_has_ended_or_was_refused_or_is_no_task_is_left_alone() -> None:
    player = Player.of("legs: command lift, inform note", "user")
    lift = player.task("user", "lift")
    sent_with = player.numbers["user"]
    player.reply("legs/1")
    assert recall(player, sent_with) == [0]
    assert [fact.text for fact in player.facts(facts.Ignored)] == [f"task {lift} has ended: it can't be killed"]
    player.send("user", "no such message")
    assert recall(player, player.numbers["user"]) == [0]
    assert lift not in player.central.tree.tasks


def test_said_again_after_a_break_it_is_done_once() -> None:
    player = Player.of("legs: goal walk", "user")
    first = player.task("user", "walk")
    request = player.numbers["user"]
    recall(player, request)
    number = player.numbers["user"]
    (answer,) = player.receive("user", Kill(number, TaskId(-request), "given up"))
    assert answer == Accepted(number, first)
    assert len(player.facts(facts.Killed)) == 1


def test_the_requests_of_others_are_theirs() -> None:
    player = Player.of("legs: goal walk", "user", "thief")
    player.task("user", "walk")
    number = player.number("thief")
    assert player.receive("thief", Kill(number, TaskId(-player.numbers["user"]))) == [Accepted(number)]


def declare(player: Player, *formats: MessageFormat) -> Refused:
    (answer,) = player.receive("user", headers.Register(player.number("user"), list(formats)))
    assert isinstance(answer, Refused)
    return answer


@pytest.fixture
def player() -> Player:
    player = Player()
    player.module("user")
    return player


def test_a_notice_is_declared_as_central_has_it(player: Player) -> None:
    other_class = MessageFormat(MODULE_LEFT.name, MessageClass.INFORM, MODULE_LEFT.format.data)
    assert declare(player, other_class).text == (
        "two formats for message 'tca: module left': a inform here, a broadcast there "
        "(here = module 'user', there = central)"
    )
    other_data = MessageFormat(MODULE_LEFT.name, MessageClass.BROADCAST, ANY)
    assert "data $: integer here, " in declare(player, other_data).text


def test_no_other_name_begins_like_a_notice(player: Player) -> None:
    refused = declare(player, MessageFormat("tca: module slept", MessageClass.INFORM, ANY))
    assert refused.text == (
        "'tca: module slept': names that begin with 'tca: ' are central's own, and it sends no such notice"
    )


@pytest.mark.parametrize("number", [0, 7])
def test_only_central_sends_notices(player: Player, number: int) -> None:
    player.receive("user", headers.Register(player.number("user"), [notice.format for notice in NOTICES.values()]))
    for name in NOTICES:
        (answer,) = player.receive("user", headers.Send(number and player.number("user"), name))
        assert answer.text == f"'{name}' is a notice: only central sends it"


def test_waits_for_handlers_are_bounded(player: Player) -> None:
    (answer,) = player.receive("user", headers.WaitUntilHandled(player.number("user"), ["a"] * 1001))
    assert answer.text == "1001 messages in one wait: 1000 are allowed, send several requests"
    (answer,) = player.receive("user", headers.WaitUntilHandled(player.number("user"), []))
    assert isinstance(answer, headers.Answer)
