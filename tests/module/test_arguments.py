"""What is wrong in a call is said where it is written, before anything leaves: what, which, and what fits."""

from collections.abc import Callable
from typing import Any

import pytest

from tca_module import (
    BadData,
    BadFormat,
    Client,
    Command,
    Condition,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    MisuseError,
    Module,
    Outcome,
    PointMonitor,
    PollingMonitor,
    Query,
    Sender,
    SentTask,
    Task,
    TaskFailed,
    this,
)

SOON = 5.0
REST, WALK, SAY, WHERE = Command("rest"), Goal("walk", float), Inform("say", str), Query("where", reply=float)
SLIPPED, FELL = Failure("slipped", float), Failure("fell")
GRIP, SHRUG = ExceptionHandler("grip", float), ExceptionHandler("shrug")
IS_FREE = Query("is the way free", reply=bool)
LOOK, LOOK_AGAIN = PointMonitor("look", condition=IS_FREE), PollingMonitor("look again", condition=IS_FREE)
ROCKS = DemonMonitor("rocks")
ANY: Any = None

Call = Callable[[Client, SentTask[None], Any], object]


def refused(call: Call, user: Client, words: str, wrong: Any = "soon") -> None:
    with pytest.raises((MisuseError, BadData), match=words):
        call(user, user.command(REST), wrong)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda _, task, x: task.kill(delay=x), "killing task 1 'rest': delay='soon' is no time: give seconds"),
        (lambda _, task, x: task.kill(scope=x), "scope='soon' is none: Scope.TASK, Scope.DESCENDANTS"),
        (lambda _, task, x: task.kill(after=x), "'soon' is no point of a task: task.achieving.end is one"),
        (lambda _, task, __: task.kill(ANY), "killing task 1 'rest': why=None is no text$"),
        (lambda _, task, __: task.kill("\ud800"), r"why='\\ud800' is no text that can be sent"),
        (lambda _, task, x: task.deadline(x), "a deadline of task 1 'rest': seconds='soon' is no time"),
        (lambda _, task, x: task.deadline(1, x), "'soon' is no point of a task"),
        (lambda _, task, x: task.wait_for(x), "'soon' is no point of a task"),
        (lambda _, task, __: task.on_termination(ANY), "takes messages of class Goal or Command, and None is none"),
        (lambda _, task, x: task.retry(WALK, x), "can't be retried with data of 'walk'"),
        (lambda user, _, x: user.command(REST, deadline=x), "command 'rest': deadline='soon' is no time"),
        (lambda user, _, __: user.command(REST, deadline=0), "command 'rest': deadline=0 is over at once: give seconds"),
        (lambda user, _, __: user.command(REST, deadline=-1), "command 'rest': deadline=-1 is no time"),
        (lambda _, task, __: task.deadline(0.0), "a deadline of task 1 'rest': seconds=0.0 is over at once"),
        (lambda user, _, __: user.command(REST, priority=True), "command 'rest' can't have priority True"),
        (lambda user, _, __: user.query(WHERE, timeout=True), "timeout=True is no time to wait"),
        (lambda user, _, __: user.command(REST, delay=float("nan")), "command 'rest': delay=nan is no time"),
        (lambda user, _, __: user.command(REST, delay=-1), "command 'rest': delay=-1 is no time"),
        (lambda user, _, x: user.command(REST, constraints=x), "constraints='soon' is no list of constraints"),
        (
            lambda user, task, _: user.command(REST, constraints=task.achieving.end <= this.achieving.start),
            "constraints=.* is no list of constraints: write constraints=",
        ),
        (lambda user, _, x: user.lock(x, 5), r"lock\(\): module=5 is no name: give 1 to 128 printable characters, or None"),
        (lambda user, _, __: user.unlock(5), "5 is no resource name: 1 to 128 printable characters are"),
        (lambda user, _, x: user.lock("arm", priority=x), r"lock\(\) can't have priority 'soon': whole numbers up to"),
        (lambda user, _, __: user.tap(Condition.WHEN_SENT, "rest", REST), "'rest' is no message"),
        (lambda user, _, __: user.tap("befor handling", REST, SAY), "is none: Condition.BEFORE_HANDLING is one"),
        (lambda user, _, __: user.task(ANY), r"task\(\) takes the number of a task, as in the journal, and None is none"),
        (lambda user, _, __: user.task(-1), "-1 is none"),
        (lambda user, _, __: user.tasks(5), "5 is no message: give the declaration, its name, or None for all"),
        (lambda user, _, x: user.constrain(x), "'soon' is no constraint: write first.achieving.end <= second"),
        (lambda user, _, x: user.status(x), r"status\(\) of topic='soon' can't be asked: status, modules, messages"),
        (lambda user, _, __: user.command(REST, 5), "command 'rest' is declared without data, and was given 5"),
        (lambda user, _, __: user.command(REST, deadline=2**70), "deadline=.* is no time: give seconds, 0 or more, at m"),
        (lambda _, task, x: task.retry(x), "'soon' is no message"),
        (lambda _, task, x: task.retry(data=x), r"needs the message, too: retry\(MESSAGE, data\)"),
        (lambda _, task, x: task.wait(x), "timeout='soon' is no time to wait"),
        (lambda _, task, x: task.achieving.end <= x, "'soon' is no point of a task"),
        (lambda _, task, x: task.achieving.end + x, "end achieving task 1 .*'soon' is no time"),
        (
            lambda _, task, __: task.achieving.end <= task.planning.end + 1,
            r"nothing can be before end planning task 1 \+ 1 s: write a \+ seconds <= b",
        ),
    ],
)  # fmt: skip
def test_wrong_values(user: Client, call: Call, words: str) -> None:
    refused(call, user, words)


def test_a_point_with_seconds_may_stand_on_either_side(user: Client) -> None:
    first, second = user.command(REST), user.command(REST)
    user.constrain(second.achieving.start >= first.achieving.end + 2.5)
    assert str(second.achieving.start >= first.achieving.end + 2.5) == (
        "end achieving task 1 + 2.5 s <= start achieving task 2"
    )


@pytest.mark.parametrize("option", ["sequential", "sequential_planning", "plan_first", "delay_planning", "keep"])
@pytest.mark.parametrize("value", ["no", 1, None])
def test_what_is_yes_or_no_is_true_or_false(user: Client, option: str, value: object) -> None:
    with pytest.raises(MisuseError, match=f"goal 'walk': {option}={value!r} is neither True nor False"):
        user.goal(WALK, 1.0, **{option: value})  # type: ignore[arg-type]


def test_none_says_that_there_is_no_bound(user: Client, legs: Module) -> None:
    legs.handles(REST)(lambda _: None)
    legs.handles(IS_FREE)(lambda _: True)
    with legs.running():
        user.on_failure(SLIPPED, SHRUG, maximum=None)
        watch = user.monitor(LOOK_AGAIN, period=0.01, maximum=None, duration=None, until=None, for_ever=True)
        assert user.command(REST, delay=0).wait(SOON) is Outcome.DONE
        assert watch.info() is not None
        watch.end()


def test_so_is_whether_a_message_comes_directly(legs: Module) -> None:
    with pytest.raises(MisuseError, match="inform 'say': direct='yes' is neither True nor False"):
        legs.handles(SAY, direct="yes")(lambda _, __: None)  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("monitor", "options", "words"),
    [
        (LOOK_AGAIN, {}, "polling monitor 'look again' needs period="),
        (LOOK_AGAIN, {"period": "x"}, "polling monitor 'look again': period='x' is no time"),
        (LOOK_AGAIN, {"period": None}, "polling monitor 'look again' needs period="),
        (LOOK_AGAIN, {"period": 0}, "period=0 is over at once: give seconds, more than 0"),
        (LOOK_AGAIN, {"period": 1, "duration": -1}, "duration=-1 is no time"),
        (LOOK_AGAIN, {"period": 1, "duration": 0}, "duration=0 is over at once"),
        (LOOK_AGAIN, {"period": 1, "maximum": 0}, "maximum=0 can't be: give 1, 2, ... or None for any number$"),
        (LOOK_AGAIN, {"period": 1, "maximum": -1}, "maximum=-1 can't be: give 1, 2, ... or None for any number$"),
        (LOOK_AGAIN, {"period": 1, "fire_every": 0}, "fire_every=0 can't be: give 1, 2, ...$"),
        (LOOK_AGAIN, {"period": 1, "initial_wait": "x"}, "initial_wait='x' is neither True nor False"),
        (LOOK_AGAIN, {"period": 1, "for_ever": 2}, "for_ever=2 is neither"),
        (LOOK_AGAIN, {"period": 1, "until": 3}, "3 is no point of a task"),
        (LOOK, {"period": 1}, "point monitor 'look' can't have period=: only polling monitors test again"),
        (ROCKS, {"period": 1}, "demon monitor 'rocks' can't have period="),
        (ROCKS, {"initial_wait": True}, "demon monitor 'rocks' can't have initial_wait="),
        (ROCKS, {"perod": 1}, "demon monitor 'rocks' can't have perod=: the options are period, maximum"),
        (REST, {}, r"monitor\(\) takes messages of class Monitor, and Command"),
    ],
)  # fmt: skip
def test_options_of_monitors(user: Client, monitor: Any, options: Any, words: str) -> None:
    with pytest.raises(MisuseError, match=words):
        user.monitor(monitor, **options)


# --- failures -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda user, _, __: user.on_failure("slipped", SHRUG), r"'slipped' is no failure: give the declaration"),
        (lambda user, _, __: user.on_failure(SLIPPED, REST), "no ExceptionHandler: declare the message as one"),
        (lambda user, _, __: user.on_failure(SLIPPED, SHRUG, of="rest"), "of='rest' never fails: give a goal, a command"),
        (lambda user, _, __: user.on_failure(SLIPPED, SHRUG, of=SAY), "of=Inform.* never fails"),
        (lambda user, _, __: user.on_failure(SLIPPED, SHRUG, maximum=-1), "exception handler 'shrug': maximum=-1 can't"),
        (lambda _, task, __: task.on_failure(SLIPPED, SHRUG, maximum=0.5), "maximum=0.5 can't be"),
        (lambda _, task, __: task.on_failure(SLIPPED, SHRUG, maximum=0), "maximum=0 can't be"),
        (lambda user, _, __: user.command(REST, on_failure=(SLIPPED, SHRUG)), "is no list of pairs: write on_failure="),
        (lambda user, _, __: user.command(REST, on_failure=[("slipped", SHRUG)]), "'slipped' is no failure"),
        (lambda _, task, __: task.fail(FELL), r"fail\(\) takes a failure with its data, .* call it, 'fell' is only"),
        (lambda _, task, __: task.fail("fell"), r"fail\(\) takes a failure with its data, and 'fell' is none"),
    ],
)  # fmt: skip
def test_what_is_no_failure_or_cannot_fail(user: Client, call: Call, words: str) -> None:
    refused(call, user, words)


@pytest.mark.parametrize(
    "call",
    [
        lambda user, _, __: user.on_failure(FELL, GRIP),
        lambda user, _, __: user.on_failure(FELL, GRIP, of=REST),
        lambda user, task, _: user.on_failure(FELL, GRIP, of=task),
        lambda _, task, __: task.on_failure(FELL, GRIP),
        lambda user, _, __: user.command(REST, on_failure=[(FELL, GRIP)]),
    ],
)
def test_an_exception_handler_that_wants_other_data_is_not_found_out_in_the_emergency(user: Client, call: Call) -> None:
    refused(call, user, "exception handler 'grip' wants data of type float, and failure 'fell' has None")


def test_an_exception_handler_without_data_fits_every_failure(user: Client) -> None:
    for failure in (SLIPPED, FELL, None):
        user.on_failure(failure, SHRUG)


def test_a_kind_of_a_failure_has_its_data_which_the_exception_handlers_of_the_other_get() -> None:
    Failure("slid", float, kind_of=SLIPPED)
    Failure("tumbled", str, kind_of=FELL)
    for data in (str, None):
        with pytest.raises(
            BadFormat, match="and 'slipped', of which it is a kind, float, which its exception handlers"
        ):
            Failure("slid", data, kind_of=SLIPPED)
    with pytest.raises(BadFormat, match="failure 'slid' can't be a kind of 'slipped': give the declaration"):
        Failure("slid", kind_of="slipped")  # type: ignore[call-overload]


def test_the_text_of_a_failure_is_a_text() -> None:
    with pytest.raises(BadData, match="failure 'fell' wants a text beside its data, and 5 is none"):
        FELL(None, 5)  # type: ignore[arg-type]


def test_a_text_that_cannot_be_sent_does_not_end_a_thread(legs: Module, user: Client) -> None:
    """As Python makes them of file names: a handler may fail with one."""

    @legs.handles(REST)
    def rest(_: Task) -> None:
        raise ValueError("no file \udcff")

    with legs.running():
        with pytest.raises(TaskFailed, match=r"handler error: ValueError: no file \\udcff"):
            user.command(REST).result(SOON)
        assert user.command(REST).wait(SOON) is Outcome.FAILED


# --- functions that replies call ----------------------------------------------------------------------------------------


async def coming(_sender: Sender, _reply: float) -> None: ...


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (None, r"query_notify\(\): None is no function: give one that takes \(sender, reply\)"),
        (coming, r"query_notify\(\): coming is 'async def', and nobody awaits it"),
        (lambda reply: reply, r"is declared with \(reply\): declare it with \(sender, reply\)"),
    ],
)
def test_what_a_reply_calls_can_be_called(user: Client, function: Any, words: str) -> None:
    with pytest.raises(MisuseError, match=words):
        user.query_notify(WHERE, None, function)
    if function is not None:
        with pytest.raises(MisuseError, match=words.replace(", reply", ", error")):
            user.query_notify(WHERE, None, print, function)
