"""Demon monitors, and what the parts of monitors get as data."""

import queue
from typing import Any

import pytest

from tca_module import (
    Client,
    Command,
    DemonMonitor,
    ExceptionHandler,
    Goal,
    Inform,
    MisuseError,
    Module,
    Outcome,
    PointMonitor,
    Query,
    Task,
    this,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import MonitorEnded

SOON = 5.0
GO, WATCH, FETCH, OTHER = Goal("go"), Command("watch"), Command("fetch", str), Command("other", int)
IS_DARK, SAY, STOP = Query("is it dark", reply=bool), Inform("say", str), Command("stop")
CUPS = DemonMonitor("cups", set_up=WATCH, action=FETCH)
BUMPS = DemonMonitor("bumps", set_up=WATCH)
NUDGES = DemonMonitor("nudges")


def test_a_monitor_is_fired_with_its_action_and_nothing_else(legs: Module, eyes: Module, user: Client) -> None:
    fetched, errors = list[str](), queue.Queue[str]()
    legs.handles(FETCH)(lambda _, cup: fetched.append(cup))

    @eyes.handles(WATCH)
    def watch(task: Task) -> None:
        with pytest.raises(MisuseError) as wrong:
            task.monitor_ref.fire(OTHER, 7)
        errors.put(str(wrong.value))

    with legs.running(), eyes.running():
        cups = user.monitor(CUPS, maximum=1)
        for_handlers = errors.get(timeout=SOON)
        assert "can't be fired with command 'other': its action is 'fetch'" in for_handlers
        with pytest.raises(MisuseError, match="can't be fired with command 'other': its action is 'fetch'"):
            cups.fire(OTHER, 7)
        with pytest.raises(MisuseError, match="can't be fired with None: its action is 'fetch'"):
            cups.fire()
        assert cups.fire(FETCH, "blue")
        assert cups.wait(SOON) is Outcome.DONE
    assert fetched == ["blue"]


def test_a_monitor_without_an_action_is_fired_without_one(eyes: Module, central: LocalCentral, user: Client) -> None:
    eyes.handles(WATCH)(lambda _: None)
    with eyes.running():
        bumps = user.monitor(BUMPS, maximum=2)
        with pytest.raises(MisuseError, match=r"it has no action, fire\(\) it without a message"):
            bumps.fire(FETCH, "blue")
        assert [bumps.fire() for _ in range(3)] == [True, True, False]
    assert [fact.why for fact in central.facts if isinstance(fact, MonitorEnded)] == ["it has sent 2 actions"]


def test_a_monitor_that_has_yet_to_begin_is_not_fired(user: Client) -> None:
    going = user.goal(GO)
    nudges = user.monitor(NUDGES, constraints=[going.handling.start <= this.handling.start])
    assert not nudges.fire()
    assert nudges.info() is not None


def test_parts_without_data_get_none(legs: Module, user: Client) -> None:
    """They need not be told what the monitor was."""
    done: queue.SimpleQueue[str] = queue.SimpleQueue()
    begin, end = Command("begin"), Command("end")

    @legs.handles(begin)
    def on_begin(task: Task) -> None:
        done.put("begin")
        task.monitor_ref.fire(SAY, "cup")
        task.monitor_ref.end()

    @legs.handles(IS_DARK)
    def is_dark(_: Task) -> bool:
        done.put("dark")
        return True

    legs.handles(STOP)(lambda _: done.put("stop"))
    legs.handles(end)(lambda _: done.put("end"))
    legs.handles(SAY)(lambda _, text: done.put(text))
    with legs.running():
        watch: PointMonitor[str] = PointMonitor("watch", str, condition=IS_DARK, action=STOP)
        assert user.monitor(watch, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(2)] == ["dark", "stop"]
        guard: DemonMonitor[str] = DemonMonitor("guard", str, set_up=begin, action=SAY, cancel=end)
        assert user.monitor(guard, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(3)] == ["begin", "cup", "end"]


def test_an_exception_handler_of_any_failure_gets_none_where_there_is_no_data(legs: Module, user: Client) -> None:
    caught: queue.SimpleQueue[Any] = queue.SimpleQueue()
    ease: ExceptionHandler[float | None] = ExceptionHandler("ease", float | None)
    legs.handles(ease)(lambda task, force: caught.put((task.trouble.failure, force)))
    with legs.running():
        user.on_failure(None, ease)
        user.command(STOP, deadline=0.01)
        assert caught.get(timeout=SOON) == ("timeout", None)
