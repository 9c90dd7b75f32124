"""Whatever somebody gives to any call that sends: an error in the words of that call, or it fits; never one from deep inside."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from tca_module import (
    BadData,
    Broadcast,
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
    MultiQuery,
    PointMonitor,
    PollingMonitor,
    Query,
    Scope,
    SentTask,
    TcaError,
    Variable,
    connect,
)
from tca_module.testing import LocalCentral

REST, WALK, SAY, HI = Command("rest"), Goal("walk", float), Inform("say", str), Broadcast("hi")
WHERE, ALL, FREE = Query("where", reply=float), MultiQuery("all", reply=int), Query("free", reply=bool)
HEAT, SLIPPED, SHRUG = Variable("heat", float), Failure("slipped", float), ExceptionHandler("shrug")
ROCKS, LOOK = DemonMonitor("rocks", action=REST), PointMonitor("look", condition=FREE)
POLL = PollingMonitor("poll", condition=FREE)
SOON = 0.01
HOSTILE = (
    None, 2.5, float("inf"), 2**70, float("nan"), -1, True, "x", "\ud800", "a" * 200, b"x", object(), [1], {"x": 1}, (1,),
    REST, SAY, WHERE, ALL, HEAT, SLIPPED, SHRUG, POLL, int,
)  # fmt: skip
PATIENT = 4  # the first of them are times that one may wait


def nothing(*_: Any) -> None: ...


CALLS: dict[str, dict[str, Any]] = {
    "goal": {"message": WALK, "data": 1.0, "sequential": True, "sequential_planning": True, "plan_first": True,
             "delay_planning": True, "priority": 0, "constraints": [], "on_failure": [], "deadline": 9.0, "delay": 9.0,
             "keep": False},
    "command": {"message": REST, "data": None},
    "query": {"message": WHERE, "data": None, "timeout": SOON, "priority": 0},
    "query_send": {"message": WHERE, "data": None, "priority": 0},
    "query_notify": {"message": WHERE, "data": None, "callback": nothing, "on_failure": nothing, "priority": 0},
    "multi_query": {"message": ALL, "data": None, "maximum": None, "timeout": SOON},
    "multi_query_send": {"message": ALL, "data": None, "maximum": None, "timeout": SOON},
    "inform": {"message": SAY, "data": "hello"},
    "broadcast": {"message": HI, "data": None},
    "execute": {"message": SAY, "data": "hello"},
    "execute_if_handled": {"message": SAY, "data": "hello"},
    "task": {"task_id": 1},
    "tasks": {"message": REST},
    "on_failure": {"failure": SLIPPED, "handler": SHRUG, "of": REST, "maximum": None},
    "tap": {"condition": Condition.WHEN_SENT, "tapped": SAY, "listener": HI},
    "monitor": {"monitor": POLL, "data": None, "period": 9.0, "maximum": None, "fire_every": 1, "initial_wait": True,
                "duration": 9.0, "until": None, "for_ever": False, "constraints": []},
    "set_variable": {"variable": HEAT, "value": 1.0, "wait": True},
    "get_variable": {"variable": HEAT, "default": None},
    "swap_variable": {"variable": HEAT, "value": 1.0},
    "lock": {"resource": "legs", "module": None, "timeout": SOON, "priority": 0},
    "reserve": {"resource": "legs", "module": None, "timeout": SOON, "priority": 0},
    "unlock": {"resource": "legs", "module": None},
    "detach": {"number": 1},
    "handlers": {"message": SAY},
    "declared": {"name": "say"},
    "status": {"topic": "status", "timeout": SOON},
}  # fmt: skip
BY_POSITION = {"constrain", "wait_until_handled", "sequence", "under"}
WITHOUT = {"modules", "parallel", "close", "name", "address"}
OF_TASKS: dict[str, dict[str, Any]] = {
    "wait": {"timeout": SOON},
    "wait_for": {"point": None, "timeout": SOON},
    "result": {"timeout": SOON},
    "kill": {"why": "", "delay": 9.0, "after": None, "scope": Scope.TASK},
    "on_termination": {"message": REST, "data": None},
    "deadline": {"seconds": 9.0, "point": None},
    "on_failure": {"failure": SLIPPED, "handler": SHRUG, "maximum": None},
    "fail": {"failure": SLIPPED(1.0)},
    "retry": {"message": REST, "data": None},
    "data": {"message": REST},
    "kept": {"message": REST},
    "children": {"message": REST},
    "ancestors": {"message": REST},
    "descendants": {"message": REST},
}
ALONE = {"id", "message", "suspend", "resume", "keep", "release", "info", "parent", "handling", "planning", "achieving"}


@pytest.fixture
def user(central: LocalCentral, legs: Module) -> Iterator[Client]:
    messages: tuple[Any, ...] = (REST, WALK, SAY, HI)
    for message in messages:
        legs.handles(message)(nothing)
    legs.handles(WHERE)(lambda _: 1.0)
    legs.handles(ALL)(lambda _: 1)
    legs.handles(FREE)(lambda _: True)
    with legs.running(), connect("user", central) as user:
        yield user


def outcome(call: Callable[[Any], object], wrong: Any) -> tuple[object, Exception | None]:
    try:
        return call(wrong), None
    except (TcaError, BadData) as error:
        return None, error


def attack(call: Callable[[Any], object], *, no_times: bool = False) -> None:
    """Give a call all that is wrong, and what may happen to be right."""
    for wrong in HOSTILE[PATIENT:] if no_times else HOSTILE:
        made, error = outcome(call, wrong)
        if error is None:
            getattr(made, "release", nothing)()
            continue
        text = str(error)
        assert text.isprintable()
        assert isinstance(error, BadData) or "Expected" not in text, f"in words of the wire: {text}"
        assert "what was given can't be sent" not in text, f"not foreseen: {text}"


def is_public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def test_every_call_of_a_sender_is_attacked() -> None:
    assert is_public(Client) == CALLS.keys() | BY_POSITION | WITHOUT
    assert is_public(SentTask) == OF_TASKS.keys() | ALONE


@pytest.mark.parametrize("name", CALLS)
def test_calls_of_a_sender(user: Client, name: str) -> None:
    right = CALLS[name]
    for argument in right:
        attack(lambda wrong: getattr(user, name)(**{**right, argument: wrong}), no_times=argument == "timeout")  # noqa: B023


@pytest.mark.parametrize("name", OF_TASKS)
def test_calls_of_a_task(user: Client, name: str) -> None:
    waits = user.command(REST, delay=3600)
    right = OF_TASKS[name] | ({"point": waits.achieving.end} if "point" in OF_TASKS[name] else {})
    for argument in right:
        attack(lambda wrong: getattr(waits, name)(**{**right, argument: wrong}), no_times=argument == "timeout")  # noqa: B023


def test_calls_with_any_number_of_arguments(user: Client) -> None:
    attack(user.constrain)
    attack(lambda wrong: user.wait_until_handled(wrong, timeout=0))
    attack(lambda wrong: user.sequence(wrong).__enter__())
    attack(user.under)


def test_what_a_demon_monitor_is_fired_with(user: Client) -> None:
    rocks = user.monitor(ROCKS)
    attack(rocks.fire)
    attack(lambda wrong: rocks.fire(REST, wrong))


def test_points_and_what_is_made_of_them(user: Client) -> None:
    point = user.command(REST, delay=3600).achieving.end
    attack(lambda wrong: point + wrong)
    attack(lambda wrong: point <= wrong)
    attack(lambda wrong: point >= wrong)
    attack(lambda wrong: point + 1 <= wrong)


def test_declaring_a_module(central: LocalCentral) -> None:
    legs = Module("legs", central)
    right: dict[str, dict[str, Any]] = {
        "resource": {"name": "arm", "capacity": 1},
        "handles": {"message": REST, "resource": "arm", "pool": "", "pending": 1, "direct": False},
        "at_start": {"function": nothing},
        "after": {"delay": 9.0, "function": nothing, "resource": ""},
        "on_readable": {"source": 0, "function": nothing, "resource": ""},
    }
    for name, arguments in right.items():
        for argument in arguments:
            attack(lambda wrong: getattr(legs, name)(**{**arguments, argument: wrong}))  # noqa: B023
    attack(legs.handles(REST))
    attack(lambda wrong: legs.every(wrong)(nothing))
    attack(legs.every(1.0))
    attack(lambda wrong: Module(wrong, central))
    attack(lambda wrong: Module("legs", wrong))
    attack(lambda wrong: Module("legs", central, capacity=wrong))
    attack(lambda wrong: Module("legs", central, requires=wrong))


NO_NAMES: tuple[Any, ...] = (0, [], "", " ", "a\nb", b"legs", False)


@pytest.mark.parametrize("wrong", NO_NAMES)
def test_what_is_no_name_does_not_count_as_none_given(legs: Module, user: Client, wrong: Any) -> None:
    idle = Module("idle", legs.central)
    calls: list[tuple[str, Callable[[], object]]] = [
        ("resource", lambda: idle.handles(REST, resource=wrong)),
        ("pool", lambda: idle.handles(REST, pool=wrong)),
        ("resource", lambda: idle.every(1.0, resource=wrong)),
        ("resource", lambda: idle.after(1.0, nothing, resource=wrong)),
        ("resource", lambda: idle.on_readable(0, nothing, resource=wrong)),
        ("module", lambda: user.lock("legs", wrong, timeout=0)),
        ("module", lambda: user.reserve("legs", module=wrong, timeout=0)),
        ("module", lambda: user.unlock("legs", wrong)),
        *(("resource", partial(call, wrong)) for call in (user.lock, user.reserve, user.unlock)),
    ]
    for option, call in calls:
        with pytest.raises(MisuseError, match=f"{option} must be 1 to 128 printable characters(, or None)?, not "):
            call()


@pytest.mark.parametrize("wrong", [0, [], "", False])
def test_nor_do_other_things_that_are_none(central: LocalCentral, user: Client, wrong: Any) -> None:
    for call in (lambda: connect("user", wrong), lambda: Module("legs", wrong)):
        with pytest.raises(MisuseError, match="central must be an address such as"):
            call()
    for ask in (user.tasks, user.command(REST).children):
        with pytest.raises(MisuseError, match="message must be a message, its name, or None for all"):
            ask(wrong)
    if wrong != []:
        with pytest.raises(MisuseError, match="requires must be a list of messages"):
            Module("legs", central, requires=wrong)


def test_none_is_none_given(central: LocalCentral, user: Client) -> None:
    """A program that passes its own options on need not leave them out."""
    arms = Module("arms", central)
    arms.handles(Command("grip"), resource=None, pool=None)(nothing)
    arms.every(60.0, resource=None)(nothing)
    with arms.running():
        with user.lock("arms", None):
            pass
        assert not user.unlock("arms", None)
        assert user.tasks(None) == []
