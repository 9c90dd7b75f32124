"""What is wrong in a call is said where it is written, before anything leaves: what, which, and what fits."""

import pytest

from tca_module import (
    BadFormat,
    Client,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    Module,
    Outcome,
    PointMonitor,
    PollingMonitor,
    Query,
    Sender,
    Task,
    TaskFailed,
)

SOON = 5.0
REST, WALK, SAY, WHERE = Command("rest"), Goal("walk", float), Inform("say", str), Query("where", reply=float)
SLIPPED, FELL = Failure("slipped", float), Failure("fell")
GRIP, SHRUG = ExceptionHandler("grip", float), ExceptionHandler("shrug")
IS_FREE = Query("is the way free", reply=bool)
LOOK, LOOK_AGAIN = PointMonitor("look", condition=IS_FREE), PollingMonitor("look again", condition=IS_FREE)


def test_a_point_with_seconds_may_stand_on_either_side(user: Client) -> None:
    first, second = user.command(REST), user.command(REST)
    user.constrain(second.achieving.start >= first.achieving.end + 2.5)
    assert str(second.achieving.start >= first.achieving.end + 2.5) == (
        "end achieving task 1 + 2.5 s <= start achieving task 2"
    )


def test_none_says_that_there_is_no_bound(user: Client, legs: Module) -> None:
    legs.handles(REST)(lambda _: None)
    legs.handles(IS_FREE)(lambda _: True)
    with legs.running():
        user.on_failure(SLIPPED, SHRUG, maximum=None)
        watch = user.monitor(LOOK_AGAIN, period=0.01, maximum=None, duration=None, until=None, for_ever=True)
        assert user.command(REST, delay=0).wait(SOON) is Outcome.DONE
        assert watch.info() is not None
        watch.end()


# --- failures -----------------------------------------------------------------------------------------------------------


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
