"""Scenarios with prefetched messages, and events that overtake them."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import tca_tools.explore as tca
from tca_module import Command, Condition, Inform, MultiQuery, Query, QueryFailed, Timeout
from tca_wire.messages.declarations import Broadcast

ASK: Query[int, int] = Query("ask", int, reply=int)
FAR: Query[int, int] = Query("far", int, reply=int)
NOTE: Inform[int] = Inform("note", int)
ALL: Broadcast[int] = Broadcast("all", int)
EACH: MultiQuery[int, int] = MultiQuery("each", int, reply=int)
STEP: Command[int, None] = Command("step", int)
SEEN: Inform[int] = Inform("seen", int)

Act = Callable[[Any, int], Any]


def answer(_: tca.Task, number: int) -> int:
    return number


def note(_: tca.Task, __: int) -> None: ...


class Street:
    """A slot of "legs" with prefetched messages. A user sends the messages, and later events
    overtake them.
    """

    def __init__(self, title: str, prefetch: int | None, *, act: Act = note, **legs: Any) -> None:
        self.scenario = tca.Scenario(title)
        self.legs = self.handling("legs", act, prefetch=prefetch, **legs)

    def handling(self, name: str, act: Act = note, **options: Any) -> tca.ScenarioModule:
        module = self.scenario.module(name, **options)
        for message in (NOTE, ALL):
            module.handles(message)(act)
        for asked in (ASK, EACH):
            module.handles(asked)(lambda task, number: [number, act(task, number)][0])
        module.handles(STEP)(note)
        return module

    def does(self, name: str, *acts: Callable[[tca.Script], object]) -> None:
        """Add a module with these actions, in order."""

        def story(me: tca.Script) -> None:
            for act in acts:
                with suppress(QueryFailed, Timeout):
                    act(me)

        self.scenario.module(name).does(story)


def informs(*numbers: int) -> Callable[[tca.Script], object]:
    return lambda me: [me.inform(NOTE, number) for number in numbers]


def asks(number: int, **options: Any) -> Callable[[tca.Script], object]:
    return lambda me: me.query(ASK, number, **options)


def locks(me: tca.Script, **options: Any) -> None:
    with me.lock("legs", priority=1, **options):
        me.inform(NOTE, 9)


def reserves(me: tca.Script) -> None:
    with me.reserve("legs", priority=1):
        me.query(ASK, 9)


def overtaken(prefetch: int | None) -> Street:
    street = Street("a message of higher priority", prefetch)
    street.does("user", informs(1, 2))
    street.does("boss", asks(3, priority=1))
    return street


def overtaken_among_more(prefetch: int | None) -> Street:
    street = Street("a message of higher priority among more", prefetch)
    street.does("user", informs(1, 2, 3))
    street.does("boss", asks(4, priority=1))
    return street


def locked(prefetch: int | None) -> Street:
    street = Street("a lock", prefetch)
    street.does("user", informs(1, 2))
    street.does("boss", locks)
    return street


def reserved(prefetch: int | None) -> Street:
    street = Street("a reservation", prefetch)
    street.does("user", informs(1, 2))
    street.does("boss", reserves)
    return street


def lock_given_up(prefetch: int | None) -> Street:
    street = Street("a lock that is given up", prefetch)
    street.does("user", informs(1, 2))
    street.does("boss", lambda me: locks(me, timeout=1.0))
    return street


def locks_itself(task: tca.Task, _: int) -> None:
    with task.lock("legs"):
        pass


def locked_from_inside(prefetch: int | None) -> Street:
    street = Street("a handler's own lock", prefetch, act=locks_itself)
    street.does("user", informs(1, 2))
    street.does("boss", asks(3, priority=1))
    return street


def locks_another(task: tca.Task, number: int) -> None:
    if number == 1:
        with task.lock("eyes"):
            pass


def locked_elsewhere(prefetch: int | None) -> Street:
    street = Street("a handler's lock of something else", prefetch, act=locks_another)
    street.scenario.module("eyes").handles(SEEN)(note)
    street.does("user", informs(1, 2, 3))
    return street


def locks_itself_once(task: tca.Task, number: int) -> None:
    if number == 1:
        with suppress(Timeout), task.lock("legs", timeout=1.0):
            pass


def locked_from_both(prefetch: int | None) -> Street:
    street = Street(
        "a handler's own lock and another, both given up", prefetch, act=locks_itself_once
    )
    street.does("user", informs(1, 2))
    street.does("boss", lambda me: locks(me, timeout=1.0), asks(3, priority=1))
    return street


def given_up(prefetch: int | None) -> Street:
    street = Street("a query that is given up", prefetch)
    street.does("user", asks(1, timeout=1.0))
    street.does("other", asks(2, timeout=2.0), asks(3))
    return street


def looks_far(task: tca.Task, number: int) -> None:
    with suppress(QueryFailed):
        task.query(FAR, number)


def busy(prefetch: int | None) -> Street:
    street = Street("handlers that ask others", prefetch, act=looks_far)
    street.scenario.module("eyes").handles(FAR)(answer)
    street.does("user", informs(1, 2))
    street.does("boss", asks(3, priority=1))
    return street


def sends(task: tca.Task, number: int) -> None:
    if number < 10:
        task.query(ASK, number + 10)


def nested(prefetch: int | None) -> Street:
    street = Street("handlers that ask themselves", prefetch, act=sends)
    street.does("user", informs(1, 2))
    street.does("boss", locks)
    return street


def leaving(prefetch: int | None) -> Street:
    street = Street("a module that leaves", prefetch, may_leave=True)
    street.handling("spare", arrives_late=True)
    street.does("user", informs(1, 2))
    street.does("other", asks(3))
    return street


def newer(prefetch: int | None) -> Street:
    street = Street("a newer handler", prefetch)
    street.handling("spare", arrives_late=True, prefetch=prefetch)
    street.does("user", informs(1, 2), asks(3))
    return street


def wider(prefetch: int | None) -> Street:
    street = Street("a further slot", prefetch, capacity=2, arrives_late=True)
    street.does("user", informs(1, 2), asks(3))
    return street


def to_many(prefetch: int | None) -> Street:
    street = Street("broadcasts", prefetch)
    street.handling("spare", prefetch=prefetch, arrives_late=True)
    street.does("user", lambda me: me.broadcast(ALL, 1), lambda me: list(me.multi_query(EACH, 2)))
    street.does("boss", asks(3, priority=1))
    return street


def tasks(prefetch: int | None) -> Street:
    street = Street("tasks among them", prefetch)
    street.does("user", informs(1), lambda me: me.command(STEP, 2), informs(3))
    street.scenario.may_kill(STEP)
    street.scenario.may_suspend(STEP)
    return street


def tapped(prefetch: int | None) -> Street:
    street = Street("a wiretap", prefetch)
    street.scenario.module("eyes").handles(SEEN)(note)
    street.does("user", informs(1, 2))
    street.does("boss", lambda me: me.tap(Condition.BEFORE_HANDLING, NOTE, SEEN))
    return street


def listened(prefetch: int | None) -> Street:
    street = Street("a wiretap that listens when all is over", prefetch)
    street.scenario.module("eyes").handles(SEEN)(note)
    street.does("user", informs(1, 2))
    street.does("boss", lambda me: me.tap(Condition.AFTER_HANDLED, NOTE, SEEN), asks(3, priority=1))
    return street


def lost(prefetch: int | None) -> Street:
    street = Street("a module that is lost", prefetch, may_be_lost=1, comes_back=True)
    street.does("user", informs(1), asks(2), informs(3))
    street.does("boss", asks(4, priority=1))
    return street


def given_up_and_leaving(prefetch: int | None) -> Street:
    street = Street("a query that is given up, of a module that leaves", prefetch, may_leave=True)
    street.handling("spare", arrives_late=True)
    street.does("user", asks(1, timeout=1.0))
    street.does("other", asks(2, timeout=1.0))
    return street


SMALL = [overtaken, locked, locked_elsewhere, tasks]
LARGE = [
    overtaken_among_more,
    newer,
    reserved,
    locked_from_inside,
    given_up,
    busy,
    nested,
    leaving,
    wider,
    to_many,
    tapped,
    listened,
    given_up_and_leaving,
]
"""Scenarios in which each outcome with prefetching is also possible without prefetching."""

UNLIKE = [lost, lock_given_up, locked_from_both]
"""Scenarios that have more outcomes with prefetching than without. A lost module loses its
prefetched messages. A lock with a timeout may end before a slot returns its prefetched messages.
"""
