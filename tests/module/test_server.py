"""A server is a handler with a method for each request of clients. Methods that are missing have
defaults.
"""

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from module.real_central import SOON

from tca_module import (
    GENERAL,
    Client,
    Command,
    Goal,
    LaterReply,
    LifeCycle,
    MisuseError,
    Module,
    Outcome,
    Party,
    Query,
    Rejected,
    Server,
    Task,
    TaskRequest,
    Transition,
    ending,
)
from tca_module.testing import LocalCentral


@dataclass
class Grip:
    item: str


PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("go on", "paused", "running"),
        *ending("paused"),
    ],
)
GRASP, WALK = Command("grasp", Grip, result=str), Goal("walk", int)
SING = Command("sing", life_cycle=PAUSABLE)
FREE = Query("free", reply=bool)


class Grasping(Server[Grip, str]):
    """A server that grasps for ten seconds, and waits in between."""

    def __init__(self) -> None:
        self.item = ""
        self.seen: list[str] = []

    def initiated(self, task: Task, goal: Grip) -> str:
        self.item = goal.item
        task.sleep(10)
        return f"holds {self.item}"

    def update(self, task: Task, goal: Grip) -> bool:
        self.seen.append(f"{task}: {goal.item}")
        if goal.item == "wall":
            raise task.rejected("a wall can't be held")
        if goal.item == "fire":
            raise ValueError(goal.item)
        self.item = goal.item
        return goal.item != "air"

    def cancel(self, task: Task, why: str) -> bool:
        self.seen.append(f"{task}: {why}")
        return why != "never"


class Holding(Server[Grip, str]):
    """A server that replies when the test lets it."""

    def __init__(self) -> None:
        self.owed: list[LaterReply[str]] = []
        self.seen: list[str] = []

    def initiated(self, task: Task, goal: Grip) -> LaterReply[str]:
        self.owed.append(task.reply_later())
        return self.owed[-1]

    def update(self, task: Task, goal: Grip) -> bool:
        self.seen.append(f"{task.state}: {goal.item}, {task.query(FREE)}")
        return True

    def cancel(self, task: Task, why: str) -> bool:
        self.seen.append(f"{task.state}: {why}")
        return True


class Walking(Server[int, None]):
    """A server that has only the method for walking."""

    def initiated(self, task: Task, goal: int) -> None:
        task.sleep(goal)


class Singing(Server[None, None]):
    async def initiated(self, task: Task, goal: None) -> None:
        await task.query_send(Query("never", reply=bool))

    def requested(self, task: Task, request: TaskRequest) -> bool:
        task.take("go on", f"after a {request.transition}")
        return True


STEPPED = True  # the tests step the clock of central


@pytest.fixture
def grasping(central: LocalCentral) -> Iterator[Grasping]:
    arm, server = Module("arm", central), Grasping()
    arm.serve(GRASP, server)
    with arm.running():
        yield server


def test_sleeping_server_receives_requests(
    user: Client, grasping: Grasping, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    central.until_quiet()
    grasp.update(Grip("cup"))
    for item, why in (
        ("air", "its handler gives no reason"),
        ("wall", "a wall can't be held"),
        ("fire", "its handler"),
    ):
        with pytest.raises(Rejected, match=why):
            grasp.update(Grip(item))
        grasping.item = "cup"
    grasp.cancel("never")
    central.advance(10)
    assert grasp.result() == "holds cup"
    assert grasping.seen == [
        f"grasp {{1}}: {what}" for what in ("cup", "air", "wall", "fire", "never")
    ]


class Counting(Server[int, None]):
    """A server that polls for requests and never blocks."""

    def __init__(self) -> None:
        self.begun, self.until = threading.Event(), 0

    def initiated(self, task: Task, goal: int) -> None:
        self.until = goal
        self.begun.set()
        while self.until:
            assert task.wait_for_request(0) is None

    def update(self, task: Task, goal: int) -> bool:
        self.until = goal
        return True


def test_busy_server_receives_requests_when_it_polls(user: Client, central: LocalCentral) -> None:
    feet, server = Module("feet", central), Counting()
    feet.serve(WALK, server)
    with feet.running():
        walk = user.goal(WALK, 1)
        assert server.begun.wait(SOON)
        walk.update(0, timeout=SOON)
        assert walk.wait(SOON) is Outcome.DONE


def test_server_grants_cancel(user: Client, grasping: Grasping, central: LocalCentral) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    changes = grasp.changes()
    grasp.cancel("the pen is hot")
    assert grasp.wait() is Outcome.KILLED
    last = list(changes)[-1]
    assert (last.transition, last.state, last.text) == (
        "aborted",
        "cancelled",
        "the pen is hot (by user)",
    )


def test_server_with_later_reply_receives_requests(user: Client, central: LocalCentral) -> None:
    arm, server = Module("arm", central), Holding()
    arm.serve(GRASP, server)
    arm.handles(FREE, resource="hand")(lambda _: True)
    with arm.running():
        grasp = user.command(GRASP, Grip("pen"))
        central.until_quiet()
        grasp.update(Grip("cup"))
        server.owed[0].reply("held")
        assert grasp.result(SOON) == "held"
        second = user.command(GRASP, Grip("tea"))
        central.until_quiet()
        second.cancel("too hot")
        assert second.wait(SOON) is Outcome.KILLED
        assert not server.owed[1].is_open
        third = user.command(GRASP, Grip("pen"))
        central.until_quiet()
        server.owed[2].reply("held again")
        assert third.result(SOON) == "held again"
    assert server.seen == ["update requested: cup, True", "cancel requested: too hot"]


def test_missing_server_methods_have_defaults(user: Client, central: LocalCentral) -> None:
    feet = Module("feet", central)
    feet.serve(WALK, Walking(), refuses=["cancel"])
    with feet.running():
        walk = user.goal(WALK, 60)
        central.until_quiet()
        walk.cancel()
        with pytest.raises(Rejected, match="it refuses 'cancel'"):
            walk.update(5)
        central.advance(60)
        assert walk.wait() is Outcome.DONE
        assert walk.state == "done"


def test_server_handles_custom_transition(user: Client, central: LocalCentral) -> None:
    choir = Module("choir", central)
    choir.serve(SING, Singing())
    with choir.running():
        sing = user.command(SING)
        changes = sing.changes()
        central.until_quiet()
        assert sing.take("pause")
        central.until_quiet()
        sing.kill()
        assert [(one.transition, one.text) for one in changes][1:3] == [
            ("pause", ""),
            ("go on", "after a pause"),
        ]


def test_invalid_server_is_misuse(central: LocalCentral) -> None:
    arm = Module("arm", central)

    class Eager(Grasping):
        async def cancel(self, task: Task, why: str) -> bool:  # type: ignore[override]
            return True

    wrong: list[tuple[Any, Any, str]] = [
        (GRASP, Grasping, r"is not a Server: give Grasping\(\)"),
        (GRASP, lambda *_: None, "is not a Server"),
        (GRASP, Eager(), "Eager.cancel: .* is 'async def', which is not awaited here"),
        (FREE, Grasping(), r"serve\(\) takes messages of class Goal or Command, not Query"),
    ]
    for message, server, words in wrong:
        with pytest.raises(MisuseError, match=words):
            arm.serve(message, server)
    with pytest.raises(MisuseError, match="leave out takes=, the Server's methods decide that"):
        arm.serve(GRASP, Grasping(), takes=["update"])
    with pytest.raises(TypeError, match="abstract"):
        Server()  # type: ignore[abstract]
    arm.serve(GRASP, Grasping())
    with pytest.raises(MisuseError, match="module 'arm' handles 'grasp' already"):
        arm.serve(GRASP, Grasping())
