"""Permissions: each kind of request is tried with each combination of permissions."""

from collections.abc import Callable, Iterable
from itertools import combinations

import msgspec
import pytest
from central.player import Player, before, point

from tca_central.access.requests import NEEDS
from tca_central.core import HANDLERS
from tca_central.events import AccessRule, PermissionsChanged
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.packets.headers import Refused
from tca_wire.packets.parts import Attachment, HandlerFormat
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, Permission, Refusal, Scope

SEND, HANDLE, TAP, LOCK, KILL, ADMINISTER = Permission
ROGUE = 50  # the number of the rogue's request

ATTACHED, TAPPED = 2, 3

Needed = list[set[tuple[Permission, str]]]
"""Alternative sets of permissions. One of these sets is enough."""


def one_of(*alternatives: str) -> Needed:
    """Return the alternatives that texts such as "send move + kill move" describe."""
    return [{_needed(part) for part in alternative.split(" + ")} for alternative in alternatives]


def _needed(text: str) -> tuple[Permission, str]:
    permission, _, name = text.partition(" ")
    return Permission(permission), name


STEER, SEE = one_of("kill move"), one_of("kill move", "tap move")
Ask = Callable[[int], object]
"""A function that makes a request about another module's task, given the task's id."""

REQUESTS: dict[str, tuple[Ask, Needed]] = {
    "send": (lambda _: headers.Send(ROGUE, "move"), one_of("send move")),
    "send a query": (lambda _: headers.Send(ROGUE, "where"), one_of("send where")),
    "send under": (lambda task: headers.Send(ROGUE, "move", TaskId(task)), one_of("send move + kill move")),
    "send on termination": (lambda task: headers.Send(ROGUE, "move", TaskId(task), when_killed=True), one_of("send move + kill move")),
    "send after": (lambda task: headers.Send(ROGUE, "move", constraints=[before(point(-1, Moment.END_ACHIEVING), point(task, Moment.END_ACHIEVING))]), one_of("send move + kill move")),
    "send with exception handler": (lambda _: headers.Send(ROGUE, "move", attachments=[Attachment("", "rescue")]), one_of("send move + send rescue")),
    "declare": (lambda _: headers.Register(ROGUE, [Player.format("command move")]), one_of("send move", "handle move", "tap move")),
    "declare a monitor": (lambda _: headers.Register(ROGUE, [msgspec.structs.replace(Player.format("polling monitor guard"), parts=["where", "note"])]), one_of("send guard + send where + send note", "handle guard + send where + send note", "tap guard + send where + send note")),
    "handle": (lambda _: headers.Register(ROGUE, [], [HandlerFormat("move", "rogue")]), one_of("handle move")),
    "constrain": (lambda task: headers.Constrain(ROGUE, [before(point(0, Moment.START_HANDLING), point(task, Moment.END_ACHIEVING), 1.0)]), STEER),
    "kill": (lambda task: headers.Kill(ROGUE, TaskId(task)), STEER),
    "kill descendants": (lambda task: headers.Kill(ROGUE, TaskId(task), scope=Scope.DESCENDANTS), STEER),
    "kill siblings": (lambda task: headers.Kill(ROGUE, TaskId(task), scope=Scope.SIBLINGS), one_of("kill move + administer root")),
    "kill all": (lambda _: headers.Kill(ROGUE, TaskId(0), scope=Scope.DESCENDANTS), one_of("administer root")),
    "raise": (lambda task: headers.Raise(ROGUE, TaskId(task), "fire"), STEER),
    "retry": (lambda task: headers.Retry(ROGUE, TaskId(task)), STEER),
    "suspend": (lambda task: headers.Suspend(ROGUE, TaskId(task)), STEER),
    "deadline": (lambda task: headers.Deadline(ROGUE, point(task, Moment.END_ACHIEVING), 60), STEER),
    "change a state": (lambda task: ChangeState(ROGUE, TaskId(task), "cancel"), STEER),
    "observe a task": (lambda task: Observe(ROGUE, TaskId(task)), SEE),
    "observe a message": (lambda _: Observe(ROGUE, message="move"), one_of("tap move")),
    "observe descendants": (lambda task: Observe(ROGUE, below=TaskId(task)), one_of("administer tree")),
    "observe all": (lambda _: Observe(ROGUE), one_of("administer tree")),
    "await": (lambda task: headers.AwaitPoint(ROGUE, point(task, Moment.END_ACHIEVING)), SEE),
    "keep": (lambda task: headers.Keep(ROGUE, TaskId(task)), SEE),
    "inspect": (lambda task: headers.Inspect(ROGUE, TaskId(task), "self"), SEE),
    "inspect all": (lambda _: headers.Inspect(ROGUE, TaskId(0), "descendants"), one_of("administer tree")),
    "ask": (lambda _: headers.Ask(ROGUE, "status"), one_of("administer status")),
    "ask for the tree": (lambda _: headers.Ask(ROGUE, "tree"), one_of("administer tree")),
    "tap": (lambda _: headers.Tap(ROGUE, Condition.WHILE_HANDLING, "note", "move"), one_of("tap move + send note")),
    "tap a task": (lambda task: headers.Tap(ROGUE, Condition.AFTER_SUCCESS, "note", task=TaskId(task)), one_of("tap move + send note")),
    "attach": (lambda _: headers.Attach(ROGUE, Attachment("", "rescue"), message="move"), one_of("tap move + send rescue")),
    "attach to a task": (lambda task: headers.Attach(ROGUE, Attachment("", "rescue"), TaskId(task)), one_of("kill move + send rescue")),
    "attach to all": (lambda _: headers.Attach(ROGUE, Attachment("", "rescue")), one_of("administer attach + send rescue")),
    "lock": (lambda _: headers.Lock(ROGUE, "boss"), one_of("lock boss.boss")),
    "unlock": (lambda _: headers.Unlock(ROGUE, "boss"), one_of("administer unlock")),
    "go on": (lambda _: headers.GoOn(ROGUE), one_of("administer resume")),
    "end central": (lambda _: headers.EndCentral(ROGUE), one_of("administer stop")),
    "set": (lambda _: headers.SetVariable(ROGUE, "speed"), one_of("send speed")),
    "get": (lambda _: headers.GetVariable(ROGUE, "speed"), one_of("send speed", "handle speed")),
    "remove": (lambda _: headers.Remove(ROGUE, ATTACHED), one_of("administer detach")),
    "remove a tap": (lambda _: headers.Remove(ROGUE, TAPPED, for_all=True), one_of("administer detach")),
    "fire": (lambda _: headers.Fire(ROGUE, TaskId(0), message="guard"), one_of("send guard")),
}  # fmt: skip

FREE: tuple[object, ...] = (
    headers.Unregister(ROGUE, []),
    headers.Reply(1),
    headers.Replies([]),
    headers.Fail(1, "x"),
    headers.Await(7),
    headers.AwaitAny(1, []),
    headers.GiveUp(7),
    headers.Release(ROGUE, 7),
    headers.Recalled([]),
    headers.WaitUntilHandled(ROGUE, ["move"]),
    headers.Ask(ROGUE, "messages"),
    headers.Ask(ROGUE, "modules"),
    headers.Hello(ROGUE, headers.PROTOCOL_VERSION, "rogue", "run of rogue"),
)

NAMES = {
    SEND: ("move", "where", "note", "rescue", "speed", "guard"),
    HANDLE: ("move", "speed", "note", "guard"),
    TAP: ("move", "guard"),
    LOCK: ("boss.boss",),
    KILL: ("move",),
    ADMINISTER: ("root", "tree", "status", "attach", "unlock", "detach", "resume"),
}


def robot(rules: Iterable[AccessRule]) -> tuple[Player, int]:
    """Return a player with a running task of the boss, and a rogue under *rules*. Also return the
    task's id.
    """
    player = Player()
    player.check = False
    player.principals |= {"rogue": "rogue"}
    player.event(
        PermissionsChanged(0.0, (AccessRule(("owner",), allowed=EVERYTHING), *rules), "a test")
    )
    player.module(
        "boss",
        "command move",
        "query where",
        "inform note",
        "exception handler rescue",
        "variable speed",
    )
    task = player.task("boss", "move")
    player.receive("boss", headers.Attach(20, Attachment("", "rescue"), message="move"))
    player.receive("boss", headers.Tap(21, Condition.WHILE_HANDLING, "note", "move"))
    player.hello("rogue")
    return player, task


EVERYTHING = tuple((permission, ("*",)) for permission in Permission)


def is_forbidden(player: Player, header: object) -> bool:
    before = len(player.entries)
    refused = [
        one.refusal for one in player.receive("rogue", header, b"\x07") if isinstance(one, Refused)
    ]
    if Refusal.FORBIDDEN not in refused:
        return False
    changes = [fact for entry in player.entries[before:] for fact in entry.facts]
    assert [type(fact) for fact in changes] == [facts.RequestRefused], (
        "a forbidden request changes nothing"
    )
    return True


def grants(
    needed: set[tuple[Permission, str]], allowed: Iterable[tuple[Permission, tuple[str, ...]]]
) -> bool:
    by_permission = dict(allowed)
    return all(
        name in names or "*" in names
        for one, name in needed
        for names in [by_permission.get(one, ())]
    )


SUBSETS = [subset for size in (0, 1, 5, 6) for subset in combinations(Permission, size)]
WAYS: dict[str, Callable[[Permission], tuple[str, ...]]] = {
    "exact": lambda permission: NAMES[permission],
    "other names": lambda permission: (*(f"{name}x" for name in NAMES[permission]), "", "?"),
    "any": lambda _: ("*",),
}


def test_every_request_has_a_permission_rule() -> None:
    assert set(NEEDS) == set(HANDLERS)


@pytest.mark.parametrize("way", WAYS)
def test_request_is_forbidden_exactly_when_not_allowed(way: str) -> None:
    """The test tries the full matrix of requests, permissions and names."""
    wrong, asked = [], 0
    for subset in SUBSETS:
        allowed = tuple((permission, WAYS[way](permission)) for permission in subset)
        for name, (ask, needed) in REQUESTS.items():
            player, task = robot([AccessRule(("rogue",), ("rogue",), allowed)])
            assert (ATTACHED in player.central.attached, TAPPED in player.central.taps) == (
                True,
                True,
            )
            expected = not any(grants(one, allowed) for one in needed)
            wrong += [(subset, name)] if is_forbidden(player, ask(task)) != expected else []
            asked += 1
    assert not wrong, f"{len(wrong)} of {asked}"


@pytest.mark.parametrize(
    "missing", [name for name, (_, needed) in REQUESTS.items() if len(needed) == 1]
)
def test_each_missing_permission_forbids_the_request(missing: str) -> None:
    """Everything is allowed except one name."""
    ask, [needed] = REQUESTS[missing]
    for permission, name in needed:
        names = {
            one: tuple(other for other in NAMES[one] if (one, other) != (permission, name))
            for one in Permission
        }
        player, task = robot([AccessRule(("rogue",), ("rogue",), tuple(names.items()))])
        assert is_forbidden(player, ask(task)), (permission, name)


def test_own_task_needs_no_further_permission() -> None:
    for name, (ask, needed) in REQUESTS.items():
        if needed in (STEER, SEE):
            player, _ = robot([AccessRule(("rogue",), ("rogue",), ((SEND, ("move",)),))])
            assert not is_forbidden(player, ask(player.task("rogue", "move"))), name


def test_own_task_gives_no_permission_over_its_siblings() -> None:
    player, task = robot([AccessRule(("rogue",), ("rogue",), ((SEND, ("move",)),))])
    player.send("rogue", "move", flags=Flags.NONE, number=ROGUE - 1)
    assert is_forbidden(player, headers.Kill(ROGUE, TaskId(1 - ROGUE), scope=Scope.SIBLINGS))
    assert not is_forbidden(player, headers.Kill(ROGUE + 1, TaskId(1 - ROGUE)))
    assert player.delivered("boss/1") == [task]


@pytest.mark.parametrize("header", FREE, ids=lambda header: type(header).__name__)
def test_free_request_needs_no_permission(header: object) -> None:
    player, _ = robot([AccessRule(("rogue",), ("rogue",))])
    assert not is_forbidden(player, header)


def test_reply_to_foreign_delivery_changes_nothing() -> None:
    player, task = robot([AccessRule(("rogue",), allowed=EVERYTHING)])
    for answer in (headers.Reply(task), headers.Fail(task, "x")):
        player.receive("rogue", answer, b"\x07")
        assert player.delivered("boss/1") == [task]


# --- names of modules -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "modules", "principal", "module", "is_let_in"),
    [
        (("arm",), ("arm",), "arm", "arm", True),
        (("arm",), ("arm",), "arm", "leg", False),
        (("arm",), ("arm",), "leg", "arm", False),
        (("arm",), ("arm",), "", "arm", False),
        (("owner",), ("arm",), "", "arm", True),
        (("arm-*",), ("arm-?",), "arm-left", "arm-1", True),
        (("arm-*",), ("arm-?",), "arm", "arm-1", False),
        (("uid:1000",), ("*",), "uid:1000", "x", True),
        (("uid:1000",), ("*",), "uid:10000", "x", False),
        (("*",), ("*",), "anybody", "any", True),
        ((), ("*",), "anybody", "any", False),
        (("Arm",), ("*",), "arm", "any", False),
    ],
)
def test_module_name_is_accepted_only_with_a_listed_key(
    keys: tuple[str, ...], modules: tuple[str, ...], principal: str, module: str, is_let_in: bool
) -> None:
    player = Player()
    player.principals["x"] = principal
    player.event(PermissionsChanged(0.0, (AccessRule(keys, modules),), "a test"))
    answers = player.hello("x", module)
    assert any(isinstance(one, headers.Welcome) for one in answers) == is_let_in
    assert [one.refusal for one in answers if isinstance(one, Refused)] == [Refusal.FORBIDDEN] * (
        not is_let_in
    )
    assert bool(player.facts(facts.ModuleJoined)) == is_let_in


def test_second_connection_keeps_the_module_of_the_first() -> None:
    """The second connection's Hello names another module, but gets no other permissions by that."""
    player = Player()
    player.principals |= {"arm": "k", "arm/1": "k"}
    rules = (AccessRule(("k",), ("arm",)), AccessRule(("k",), ("boss",), EVERYTHING))
    player.event(PermissionsChanged(0.0, rules, "a test"))
    player.hello("arm")
    hello = headers.Hello(1, headers.PROTOCOL_VERSION, "boss", "run of arm", 1)
    player.receive("arm/1", hello)
    refused = player.receive("arm/1", headers.Ask(2, "status"))
    assert [one.refusal for one in refused if isinstance(one, Refused)] == [Refusal.FORBIDDEN]


# --- rules that change ----------------------------------------------------------------------------


def test_changed_rules_apply_to_connected_modules() -> None:
    player, task = robot([AccessRule(("rogue",), allowed=EVERYTHING)])
    player.receive("rogue", headers.Register(9, [], [HandlerFormat("move", "rogue")]))
    player.receive("rogue", headers.Tap(10, Condition.WHEN_SENT, "note", "move"))
    message = player.central.registry.messages["move"]
    assert [len(message.handlers), len(message.taps)] == [2, 2]
    player.event(
        PermissionsChanged(
            60.0, (AccessRule(("owner",), allowed=EVERYTHING), AccessRule(("rogue",)))
        )
    )
    assert [len(message.handlers), len(message.taps)] == [1, 1]
    assert is_forbidden(player, headers.Kill(ROGUE, TaskId(task)))
    player.event(PermissionsChanged(61.0, None))
    assert not is_forbidden(player, headers.Kill(ROGUE + 1, TaskId(task)))


def test_module_without_a_rule_is_disconnected() -> None:
    player, _ = robot([AccessRule(("rogue",), allowed=EVERYTHING)])
    player.event(
        PermissionsChanged(60.0, (AccessRule(("owner",), allowed=EVERYTHING),), "robot.toml")
    )
    (left,) = player.facts(facts.ModuleLeft)
    assert (left.module, left.lost) == ("rogue", True)
    assert [(fact.rules, fact.source) for fact in player.facts(facts.PermissionsChanged)][1:] == [
        (1, "robot.toml")
    ]


def test_exception_handler_needs_no_permission_for_its_retry() -> None:
    """A running exception handler may retry the failed task and its ancestors, but kill no other
    task.
    """
    player = Player()
    player.principals |= {"medic": "medic", "medic/1": "medic"}
    medic = AccessRule(("medic",), allowed=((HANDLE, ("rescue",)),))
    player.event(PermissionsChanged(0.0, (AccessRule(("owner",), allowed=EVERYTHING), medic)))
    player.module("medic", "exception handler rescue")
    player.module("boss", "command move")
    other = player.task("boss", "move")
    player.receive("boss", headers.Attach(20, Attachment("", "rescue"), message="move"))
    player.fail("boss/1", "fire")
    assert player.delivered("medic/1")
    player.task("boss", "move", number=60)
    sibling = player.central.tree.newest
    origin = player.delivered("medic/1")[0]
    refused = player.receive("medic/1", headers.Kill(9, TaskId(sibling), origin=origin))
    assert [one.refusal for one in refused if isinstance(one, Refused)] == [Refusal.FORBIDDEN]
    answers = player.receive("medic/1", headers.Retry(10, TaskId(other), origin=origin))
    assert not [one for one in answers if isinstance(one, Refused)]


def test_only_the_handler_changes_its_tasks_state() -> None:
    player = Player()
    player.principals |= {"arm": "arm", "arm/1": "arm", "leg": "leg", "leg/1": "leg"}
    arm, leg = (
        AccessRule((name,), (name,), ((HANDLE, (what,)),))
        for name, what in (("arm", "move"), ("leg", "step"))
    )
    player.event(PermissionsChanged(0.0, (AccessRule(("owner",), allowed=EVERYTHING), arm, leg)))
    player.module("arm", "command move")
    player.module("leg", "command step")
    player.module("boss")
    player.declare("boss", "command move", "command step")
    task, step = player.task("boss", "move"), player.task("boss", "step", flags=Flags.NONE)
    *_, refused = player.change("leg/1", task, "result available", 5, origin=step)
    assert isinstance(refused, Refused)
    # The delivery is not one of the boss.
    *_, refused = player.change("boss", task, "result available", 5, origin=task)
    assert isinstance(refused, Refused)
    assert isinstance(player.change("arm/1", task, "result available", 5)[-1], headers.Accepted)
