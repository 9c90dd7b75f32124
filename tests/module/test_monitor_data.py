"""What the messages of a monitor get as data; and what can't be is found where the monitor is declared."""

import queue
from typing import Any

import pytest
from msgspec import Struct

from tca_module import (
    BadFormat,
    Client,
    Command,
    DemonMonitor,
    ExceptionHandler,
    Goal,
    Inform,
    Module,
    Outcome,
    PointMonitor,
    PollingMonitor,
    Query,
    Task,
)

SOON = 5.0


class Cup(Struct):
    colour: str


class Mug(Struct):
    colour: str


class Place(Struct):
    x: float


IS_GONE: Query[str, bool] = Query("is it gone", str, reply=bool)
IS_DARK: Query[None, bool] = Query("is it dark", reply=bool)
SEEN: Query[None, Cup | None] = Query("seen", reply=Cup | None)
LEVEL: Query[None, float | bool] = Query("level", reply=float | bool)
TAKE_CUP, TAKE_MUG, GO, STOP, SAY = (
    Goal("take", Cup),
    Goal("take", Mug),
    Goal("go", Place),
    Command("stop"),
    Inform("say", str),
)
SINK: Command[float, None] = Command("sink", float)
TAKE_ANY: Goal[Any] = Goal("take any", Any)
ANYTHING: Query[Any, Any] = Query("anything", Any, reply=Any)


@pytest.mark.parametrize(
    ("data", "condition", "action"),
    [
        (str, IS_GONE, SAY),
        (str, IS_GONE, STOP),
        (str, IS_DARK, SAY),
        (Cup, IS_DARK, TAKE_CUP),
        (Cup, IS_DARK, TAKE_MUG),  # the same fields by another name
        (None, SEEN, TAKE_CUP),
        (None, SEEN, TAKE_ANY),
        (None, SEEN, STOP),
        (None, LEVEL, SINK),
        (int, ANYTHING, TAKE_CUP),
        (Any, IS_GONE, SAY),
    ],
)
def test_what_fits(data: Any, condition: Any, action: Any) -> None:
    for kind in (PointMonitor, PollingMonitor):
        kind("watch", data, condition=condition, action=action)


@pytest.mark.parametrize(
    ("data", "condition", "action", "words"),
    [
        (None, IS_GONE, None, "the condition 'is it gone' of KIND 'watch' wants data of type str, and gets the monitor's own, N"),
        (int, IS_GONE, None, "wants data of type str, and gets the monitor's own, int: declare both with the same type, or it w"),
        (str, IS_GONE, SINK, "the action 'sink' of KIND 'watch' wants data of type float, and gets the monitor's own, str"),
        (None, IS_DARK, SAY, "the action 'say' of KIND 'watch' wants data of type str, and gets the monitor's own, None"),
        (None, SEEN, GO, "the action 'go' of KIND 'watch' wants data of type Place, and gets what 'seen' replies, "),
        (None, LEVEL, SAY, "and gets what 'level' replies, float | bool"),
    ],
)  # fmt: skip
def test_what_cannot_fit_is_refused_where_it_is_declared(data: Any, condition: Any, action: Any, words: str) -> None:
    for kind in (PointMonitor, PollingMonitor):
        with pytest.raises(BadFormat) as error:
            kind("watch", data, condition=condition, action=action)
        assert words.replace("KIND", str(kind.message_class)) in str(error.value)


def test_a_monitor_of_no_condition() -> None:
    nothing: Any = None
    with pytest.raises(
        BadFormat, match="the condition of point monitor 'watch' can be of class Query, and None is not"
    ):
        PointMonitor("watch", condition=nothing)


def test_what_a_demon_monitor_sends() -> None:
    DemonMonitor("watch", Cup, set_up=TAKE_CUP, action=SAY, cancel=STOP)
    for what in ("set-up", "cancel message"):
        option: Any = {what.partition(" ")[0].replace("-", "_"): SAY}
        with pytest.raises(
            BadFormat, match=f"the {what} 'say' of demon monitor 'watch' wants data of type str, and gets"
        ):
            DemonMonitor("watch", Cup, **option)


def test_parts_without_data_get_none(legs: Module, user: Client) -> None:
    """They need not be told what the monitor was."""
    done: queue.SimpleQueue[str] = queue.SimpleQueue()
    begin, end = Command("begin"), Command("end")

    @legs.handles(IS_DARK)
    def is_dark(_: Task) -> bool:
        done.put("dark")
        return True

    @legs.handles(STOP)
    def stop(_: Task) -> None:
        done.put("stop")

    @legs.handles(begin)
    def on_begin(task: Task) -> None:
        done.put("begin")
        task.monitor_ref.fire(SAY, "cup")
        task.monitor_ref.end()

    @legs.handles(end)
    def on_end(_: Task) -> None:
        done.put("end")

    @legs.handles(SAY)
    def say(_: Task, text: str) -> None:
        done.put(text)

    with legs.running():
        watch: PointMonitor[str] = PointMonitor("watch", str, condition=IS_DARK, action=STOP)
        assert user.monitor(watch, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(2)] == ["dark", "stop"]
        guard: DemonMonitor[str] = DemonMonitor("guard", str, set_up=begin, action=SAY, cancel=end)
        assert user.monitor(guard, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(3)] == ["begin", "cup", "end"]


# --- exception handlers of any failure -----------------------------------------------------------------------------------


def test_what_central_raises_has_no_data(legs: Module, user: Client) -> None:
    caught: queue.SimpleQueue[Any] = queue.SimpleQueue()
    ease: ExceptionHandler[float | None] = ExceptionHandler("ease", float | None)

    @legs.handles(ease)
    def on_ease(task: Task, force: float | None) -> None:
        caught.put((task.trouble.failure, force))

    with legs.running():
        user.on_failure(None, ease)
        user.command(STOP, deadline=0.01)
        assert caught.get(timeout=SOON) == ("timeout", None)
