"""A wrong call raises before anything is sent, and names the argument, its value and the allowed
values.
"""

import re
import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from module.real_central import SOON

import tca_module
import tca_tools.explore
from tca_module import (
    BadData,
    BadFormat,
    Broadcast,
    Claim,
    Client,
    Command,
    Condition,
    Constraint,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    LaterReply,
    MisuseError,
    Module,
    MultiQuery,
    Point,
    PointMonitor,
    PollingMonitor,
    Query,
    Scope,
    SentTask,
    Task,
    TcaError,
    Variable,
    connect,
)
from tca_module.testing import LocalCentral

REST, WALK, SAY, HI = Command("rest"), Goal("walk", float), Inform("say", str), Broadcast("hi")
WHERE, ALL, FREE = (
    Query("where", reply=float),
    MultiQuery("all", reply=int),
    Query("free", reply=bool),
)
HEAT, SLIPPED, FELL = Variable("heat", float), Failure("slipped", float), Failure("fell")
GRIP, SHRUG = ExceptionHandler("grip", float), ExceptionHandler("shrug")
LOOK, POLL = PointMonitor("look", condition=FREE), PollingMonitor("poll", condition=FREE)
ROCKS, BLIND = DemonMonitor("rocks", action=REST), DemonMonitor("blind")


async def coming(_sender: Any, _reply: float) -> None: ...


class Printed:
    """An object without a format."""


def wrong_data(_task: Task, _distance: list[int]) -> None: ...


def two(_first: Any, _second: Any) -> None: ...


def test_wrong_call_matches_approved_text(
    user: Client, legs: Module, approve: Callable[..., None]
) -> None:
    names = {
        **vars(tca_module),
        **globals(),
        "user": user,
        "task": user.command(REST),
        "legs": legs,
    }

    def error_of_call(call: str) -> BaseException:
        with pytest.raises((MisuseError, BadData, BadFormat, TypeError)) as error:
            eval(call, names)
        return error.value

    approve("misuse.txt", error_of_call)


def test_call_at_wrong_time_or_in_wrong_thread_is_misuse(user: Client, legs: Module) -> None:
    steps: list[str] = []

    def elsewhere() -> None:
        with pytest.raises(MisuseError, match="belongs to thread "):
            user.broadcast(HI)
        steps.append("refused")

    @legs.handles(REST)
    def rest(task: Task) -> LaterReply[None]:
        with pytest.raises(MisuseError, match="comes too late: declare it before run"):
            legs.resource("arm")
        with pytest.raises(MisuseError, match="runs already"):
            legs.run()
        later = task.reply_later()
        with pytest.raises(MisuseError, match="give it FAILURE"):
            later.fail("rock")  # type: ignore[arg-type]
        later.reply()
        with pytest.raises(MisuseError, match="has been answered already"):
            later.reply()
        steps.append("late")
        return later

    with legs.running():
        user.command(REST).result(SOON)
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join(SOON)
    user.close()
    with pytest.raises(MisuseError, match="this client is closed"):
        user.query(WHERE)
    assert steps == ["late", "refused"]


# --- Hostile arguments for every call that sends --------------------------------------------------


BRIEFLY = 0.01
HOSTILE = (
    None,
    2.5,
    float("inf"),
    2**70,
    float("nan"),
    -1,
    True,
    "x",
    "\ud800",
    "a" * 200,
    b"x",
    object(),
    [1],
    {"x": 1},
    (1,),
    REST,
    SAY,
    WHERE,
    ALL,
    HEAT,
    SLIPPED,
    SHRUG,
    POLL,
    int,
)
TIMES = 4  # the number of values at the front that are valid times


def nothing(*_: Any) -> None: ...


ATTACKED: dict[str, dict[str, Any]] = {
    "goal": {"message": WALK, "data": 1.0, "sequential": True, "sequential_planning": True, "plan_first": True,
             "delay_planning": True, "priority": 0, "constraints": [], "on_failure": [], "deadline": 9.0, "delay": 9.0,
             "keep": False},
    "command": {"message": REST, "data": None},
    "query": {"message": WHERE, "data": None, "timeout": BRIEFLY, "priority": 0},
    "query_send": {"message": WHERE, "data": None, "priority": 0},
    "query_notify": {"message": WHERE, "data": None, "callback": nothing, "on_failure": nothing, "priority": 0},
    "multi_query": {"message": ALL, "data": None, "maximum": None, "timeout": BRIEFLY},
    "multi_query_send": {"message": ALL, "data": None, "maximum": None, "timeout": BRIEFLY},
    "inform": {"message": SAY, "data": "hello"},
    "broadcast": {"message": HI, "data": None},
    "execute": {"message": SAY, "data": "hello"},
    "execute_if_handled": {"message": SAY, "data": "hello"},
    "task": {"task_id": 1},
    "sent_task": {"message": REST, "task_id": 1, "epoch": ""},
    "tasks": {"message": REST},
    "on_failure": {"failure": SLIPPED, "handler": SHRUG, "of": REST, "maximum": None},
    "fire": {"monitor": ROCKS, "action": REST, "data": None},
    "tap": {"condition": Condition.WHEN_SENT, "tapped": SAY, "listener": HI},
    "monitor": {"monitor": POLL, "data": None, "period": 9.0, "maximum": None, "fire_every": 1, "initial_wait": True,
                "duration": 9.0, "until": None, "waited_for": False, "constraints": []},
    "set_variable": {"variable": HEAT, "value": 1.0, "wait": True},
    "get_variable": {"variable": HEAT, "default": None},
    "swap_variable": {"variable": HEAT, "value": 1.0},
    "lock": {"resource": "legs", "module": None, "timeout": BRIEFLY, "priority": 0},
    "reserve": {"resource": "legs", "module": None, "timeout": BRIEFLY, "priority": 0},
    "unlock": {"resource": "legs", "module": None},
    "detach": {"number": 1},
    "go_on": {},
    "end_central": {"keep": True},
    "handlers": {"message": SAY},
    "declared": {"name": "say"},
    "status": {"topic": "status", "timeout": BRIEFLY},
    "observe": {"message": WALK, "states": ["running"], "below": None, "timeout": BRIEFLY},
    "cancel_all": {"message": REST, "before": 9.0, "why": ""},
}  # fmt: skip
BY_POSITION = {"constrain", "wait_until_handled", "sequence", "under"}
WITHOUT = {"time", "modules", "messages", "parallel", "close", "name", "address"}
OF_TASKS: dict[str, dict[str, Any]] = {
    "wait": {"timeout": BRIEFLY},
    "wait_for": {"point": None, "timeout": BRIEFLY},
    "result": {"timeout": BRIEFLY},
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
    "changes": {"timeout": BRIEFLY},
    "next_change": {"timeout": BRIEFLY},
    "progress": {"kind": None, "timeout": BRIEFLY},
    "wait_for_state": {"timeout": 0.0},
    "on_change": {"function": nothing},
    "update": {"goal": None, "timeout": BRIEFLY, "message": REST},
    "update_send": {"goal": None, "message": REST},
    "cancel": {"why": ""},
    "take": {"transition": "cancel", "data": None, "why": "", "message": REST},
}
ALONE = {
    "id",
    "state",
    "serial",
    "follow",
    "suspend",
    "resume",
    "keep",
    "release",
    "info",
    "parent",
    "handling",
    "planning",
    "achieving",
}


@pytest.fixture
def sender(central: LocalCentral, legs: Module) -> Iterator[Client]:
    messages: tuple[Any, ...] = (REST, WALK, SAY, HI)
    for message in messages:
        legs.handles(message)(nothing)
    legs.handles(WHERE)(lambda _: 1.0)
    legs.handles(ALL)(lambda _: 1)
    legs.handles(FREE)(lambda _: True)
    with legs.running(), connect("sender", central) as sender:
        yield sender


def outcome(call: Callable[[Any], object], wrong: Any) -> tuple[object, Exception | None]:
    try:
        made = call(wrong)
        getattr(made, "id", None)  # a sent message may be refused afterwards
    except (TcaError, BadData) as error:
        return None, error
    return made, None


def attack(call: Callable[[Any], object], *, no_times: bool = False) -> None:
    """Give a call all hostile values. Some of these values may be valid for the call."""
    for wrong in HOSTILE[TIMES:] if no_times else HOSTILE:
        made, error = outcome(call, wrong)
        if error is None:
            if isinstance(made, Claim):
                made.release()
            continue
        text = str(error)
        assert text.isprintable()
        assert isinstance(error, BadData) or "Expected" not in text, (
            f"not in the user's words: {text}"
        )
        assert "what was given can't be sent" not in text, f"not foreseen: {text}"


def is_public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def test_every_public_call_is_covered_by_attacks() -> None:
    assert is_public(Client) == ATTACKED.keys() | BY_POSITION | WITHOUT
    assert is_public(SentTask) == OF_TASKS.keys() | ALONE


@pytest.mark.parametrize("name", ATTACKED)
def test_sender_call_survives_hostile_arguments(sender: Client, name: str) -> None:
    right = ATTACKED[name]
    for argument in right:
        attack(
            lambda wrong: getattr(sender, name)(**{**right, argument: wrong}),  # noqa: B023
            no_times=argument == "timeout",
        )


@pytest.mark.parametrize("name", OF_TASKS)
def test_sent_task_call_survives_hostile_arguments(sender: Client, name: str) -> None:
    waits = sender.command(REST, delay=3600)
    right = OF_TASKS[name] | ({"point": waits.achieving.end} if "point" in OF_TASKS[name] else {})
    for argument in right:
        attack(
            lambda wrong: getattr(waits, name)(**{**right, argument: wrong}),  # noqa: B023
            no_times=argument == "timeout",
        )


def test_variadic_call_survives_hostile_arguments(sender: Client) -> None:
    attack(sender.constrain)
    attack(lambda wrong: sender.wait_until_handled(wrong, timeout=0))
    attack(lambda wrong: sender.sequence(wrong).__enter__())
    attack(sender.under)


def test_fire_survives_hostile_arguments(sender: Client) -> None:
    rocks = sender.monitor(ROCKS)
    attack(rocks.fire)
    attack(lambda wrong: rocks.fire(REST, wrong))


def test_point_arithmetic_survives_hostile_operands(sender: Client) -> None:
    point = sender.command(REST, delay=3600).achieving.end
    attack(lambda wrong: point + wrong)
    attack(lambda wrong: point <= wrong)
    attack(lambda wrong: point >= wrong)
    attack(lambda wrong: point + 1 <= wrong)


def test_module_declaration_survives_hostile_arguments(central: LocalCentral) -> None:
    legs = Module("legs", central)
    right: dict[str, dict[str, Any]] = {
        "resource": {"name": "arm", "capacity": 1, "when_busy": "reject"},
        "handles": {
            "message": REST,
            "resource": "arm",
            "pool": "",
            "pending": 1,
            "accepts": False,
            "takes": ["update"],
            "refuses": ["cancel"],
            "when_busy": "queue",
        },
        "observes": {"message": WALK, "states": ["running"], "resource": ""},
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


@pytest.mark.parametrize(
    "made",
    [
        lambda point: Constraint(point, point, "soon"),  # type: ignore[arg-type]
        lambda point: Constraint(None, point),  # type: ignore[arg-type]
        lambda point: Constraint(Point("x", point.moment), point),  # type: ignore[arg-type]
    ],
)
def test_malformed_constraint_is_misuse(sender: Client, made: Callable[[Any], Any]) -> None:
    point = sender.command(REST, delay=3600).achieving.end
    with pytest.raises(MisuseError, match="an option can't be sent"):
        sender.command(REST, constraints=[made(point)])


NO_NAMES: tuple[Any, ...] = (0, [], "", " ", "a\nb", b"legs", False)


@pytest.mark.parametrize("wrong", NO_NAMES)
def test_invalid_name_is_misuse_not_default(legs: Module, sender: Client, wrong: Any) -> None:
    idle = Module("idle", legs.central)
    calls: list[tuple[str, Callable[[], object]]] = [
        ("resource", lambda: idle.handles(REST, resource=wrong)),
        ("pool", lambda: idle.handles(REST, pool=wrong)),
        ("resource", lambda: idle.every(1.0, resource=wrong)),
        ("resource", lambda: idle.after(1.0, nothing, resource=wrong)),
        ("resource", lambda: idle.on_readable(0, nothing, resource=wrong)),
        ("module", lambda: sender.lock("legs", wrong, timeout=0)),
        ("module", lambda: sender.reserve("legs", module=wrong, timeout=0)),
        ("module", lambda: sender.unlock("legs", wrong)),
        *(
            ("resource", partial(call, wrong))
            for call in (sender.lock, sender.reserve, sender.unlock)
        ),
    ]
    for option, call in calls:
        with pytest.raises(
            MisuseError, match=f"{option} must be 1 to 128 printable characters(, or None)?, not "
        ):
            call()


@pytest.mark.parametrize("wrong", [0, [], "", False])
def test_falsy_argument_is_misuse_not_default(
    central: LocalCentral, sender: Client, wrong: Any
) -> None:
    for call in (lambda: connect("sender", wrong), lambda: Module("legs", wrong)):
        with pytest.raises(MisuseError, match="central must be an address such as"):
            call()
    for ask in (sender.tasks, sender.command(REST).children):
        with pytest.raises(
            MisuseError, match="message must be a message, its name, or None for all"
        ):
            ask(wrong)
    if wrong != []:
        with pytest.raises(MisuseError, match="requires must be a list of messages"):
            Module("legs", central, requires=wrong)


def test_none_counts_as_option_left_out(central: LocalCentral, sender: Client) -> None:
    """A program that passes on its own options need not leave out those that are None."""
    arms = Module("arms", central)
    arms.handles(Command("grip"), resource=None, pool=None)(nothing)
    arms.every(60.0, resource=None)(nothing)
    with arms.running():
        with sender.lock("arms", None):
            pass
        assert not sender.unlock("arms", None)
        assert sender.tasks(None) == []


# --- Errors of constructors name only public classes and arguments --------------------------------


PUBLIC: dict[str, type] = {
    f"{package.__name__}.{name}": thing
    for package in (tca_module, tca_tools.explore)
    for name in dir(package)
    if isinstance(thing := getattr(package, name), type)
} | {"tca_module.testing.LocalCentral": LocalCentral}

WRITTEN = [
    tca_module.Goal,
    tca_module.Command,
    tca_module.Query,
    tca_module.MultiQuery,
    tca_module.Inform,
    tca_module.Broadcast,
    tca_module.Variable,
    tca_module.ExceptionHandler,
    tca_module.PointMonitor,
    tca_module.PollingMonitor,
    tca_module.DemonMonitor,
    tca_module.Failure,
    tca_module.Module,
    LocalCentral,
    tca_tools.explore.Scenario,
    tca_tools.explore.Property,
]
"""The classes that users construct themselves."""

WRONG: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((), {}),
    (("x",), {}),
    ((), {"nonsense": 1}),
    (("x",), {"nonsense": 1}),
    ((1,) * 20, {}),
    ((None, None), {}),
]


def errors_of(kind: Any) -> Iterator[str]:
    for arguments, options in WRONG:
        try:
            kind(*arguments, **options)
        except Exception as error:  # noqa: BLE001 - whatever it is: it is the text that matters
            yield str(error)


@pytest.mark.parametrize("kind", PUBLIC.values(), ids=PUBLIC)
def test_constructor_error_names_nothing_private(kind: type) -> None:
    for text in errors_of(kind):
        assert not re.search(
            r"(?<![\w.])_[A-Za-z]\w*", text.replace("__init__", "").replace("__new__", "")
        ), text


@pytest.mark.parametrize("kind", WRITTEN, ids=lambda kind: kind.__name__)
def test_constructor_error_names_class_and_argument(kind: Any) -> None:
    with pytest.raises(
        TypeError,
        match=rf"^{kind.__name__}(\.__init__)?\(\):? got an unexpected keyword argument 'nonsense'",
    ):
        kind("x", nonsense=1)
    if kind is not LocalCentral:
        with pytest.raises(TypeError, match=rf"^{kind.__name__}(\.__init__)?\(\):? missing .*: '"):
            kind()


def test_numpy_floats_are_accepted_as_seconds(user: Client, legs: Module) -> None:
    """These values are Python floats, too, but msgspec treats them as another type."""
    legs.handles(REST)(lambda _: None)
    legs.handles(WHERE)(lambda _: 1.0)
    one = np.float64(1)
    with legs.running():
        assert user.query(WHERE, timeout=one / 2) == 1.0
        rest = user.command(REST, deadline=one * SOON, delay=one / 100)
        assert rest.wait(np.float64(SOON))
        user.lock("legs", timeout=one).release()
