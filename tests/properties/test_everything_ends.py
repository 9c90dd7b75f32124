"""Random lives full of trouble end. When all handlers have returned, all tasks are resumed and time
has passed, nothing is left. No endless wait is overlooked, and termination messages get past every
lock.
"""

from central.player import Player, point
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.blocking import HANDLED, Blocking, Steps, free_handlers
from properties.life import Life
from sampling import lives

from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, Role, Scope

EXCEPTION_HANDLERS = {
    "b": ("exception handler mend",),
    "d": ("exception handler save", "command park"),
}
FAILURES = ("slipped", "timeout", "deadlock", "")
STEPS = (
    ["send"] * 5
    + ["return"] * 3
    + ["ask", "await", "lock", "attach"] * 2
    + [
        "wait",
        "constrain",
        "kill",
        "suspend",
        "fail",
        "raise",
        "retry",
        "parting",
        "deadline",
        "kill others",
        "tap",
    ]
)
steps = st.lists(st.tuples(st.sampled_from(STEPS), *[st.integers(0, 50)] * 3), max_size=40)
ROUNDS = 2_000
QUIET = 6  # rounds in which no handler returns: central may still search for deadlocks


class Troubled(Blocking):
    """Modules that block and fail. The modules that handle their failures block, too."""

    handled = HANDLED | {
        name: HANDLED.get(name, ()) + menders for name, menders in EXCEPTION_HANDLERS.items()
    }

    def __init__(self) -> None:
        super().__init__(looks=True)
        self.declare("operator", "command park", "command move", "goal step")

    def do(self, operation: str, a: int, b: int, c: int) -> None:
        """Let one handler, the user or the operator act."""
        free, tasks = self.free(), [TaskId(task) for task in self.central.tree.tasks]
        delivery = free[a % len(free)] if free else None
        task = tasks[b % len(tasks)] if tasks else TaskId(0)
        match operation:
            case "fail" if delivery is not None and delivery.slot is not None:
                is_reissued = delivery.role is Role.EXCEPTION and b % 2 == 0
                self.fail(
                    delivery.slot.id.decode(),
                    FAILURES[c % 3],
                    delivery.handling_id,
                    reissue=is_reissued,
                )
            case "raise" if task:
                self.request("operator", headers.Raise, task, FAILURES[c % 3])
            case "retry" if task:
                self.request("operator", headers.Retry, task)
            case "parting" if task:
                self.send("operator", ("move", "park", "step")[c % 3], under=task, when_killed=True)
            case "attach":
                attachment = Attachment(FAILURES[a % 4], ("mend", "save")[c % 2], c % 3)
                where = TaskId(0) if b % 3 == 0 else task
                self.request("operator", headers.Attach, attachment, where)
            case "deadline" if task:
                at = point(task, list(Moment)[c % 6])
                self.request("operator", headers.Deadline, at, a)
            case "kill others" if task:
                scope = (Scope.DESCENDANTS, Scope.SIBLINGS)[c % 2]
                self.request("operator", headers.Kill, task, "", scope)
            case "tap":
                self.tap(
                    task if b % 3 == 0 else TaskId(0), ("move", "walk", "step", "mend")[a % 4], b, c
                )
            case _:
                super().do(operation, a, b, c)

    def tap(self, task: TaskId, message: str, b: int, c: int) -> None:
        """Let the operator tap a task or a message. The task may be queued, and the listener may
        block.
        """
        condition = (
            Condition.BEFORE_HANDLING,
            Condition.BEFORE_HANDLING,
            Condition.BEFORE_ACHIEVING,
        )[b % 3]
        message, listener = "" if task else message, ("park", "move", "step")[c % 3]
        self.request("operator", headers.Tap, condition, listener, message, task)


class Mixed(Life):
    """A life with all constructs, and with modules that join and leave."""

    def end(self) -> None:
        """End the life: give each message a handler and each resource a slot. Everything must end
        then.
        """
        for module in [*self.central.registry.modules.values()]:
            if any(not resource.slots for resource in module.resources.values()):
                for connection in [*module.connections.values()]:
                    self.player.lose(connection.id.decode())
        for name in self.modules:
            self.join(name)
        self.player.module("late", "command later")
        assert_everything_ends(self.player)


def assert_everything_ends(player: Player) -> None:
    """Let all handlers return, resume all tasks, end all monitors, release all locks outside of
    tasks, and let time pass. Nothing may be left then.
    """
    central, quiet, rounds = player.central, 0, 0
    while quiet < QUIET and rounds < ROUNDS:
        for task in list(central.tree.tasks.values()):
            if task.suspended:
                player.request("user", headers.Suspend, TaskId(task.id), resume=True)
            if task.message.message_class.is_monitor:
                player.request("user", headers.EndMonitor, TaskId(task.id))
        for claim in list(central.claims.values()):
            if claim.holder is None and not claim.slot.waits:
                player.receive(claim.slot.id.decode(), headers.GiveUp(claim.number))
        if free := free_handlers(central):
            assert free[0].slot
            player.reply(free[0].slot.id.decode(), free[0].handling_id, value=False)
        player.tick(10.0)
        quiet, rounds = 0 if free else quiet + 1, rounds + 1
    waits = [(slot.id, number) for slot in central.blocked for number in slot.waits]
    left = {task: [*(task.children or {}).values()] for task in central.tree.tasks.values()}
    assert (left, waits) == ({}, []), "will never end, but was not reported"
    assert not central.claims, "claims are left"
    assert rounds < ROUNDS, "there is no end"


KEPT_FOR_A_RETRY = [
    ("send", 0, 0, 0),
    ("lock", 0, 1, 0),
    ("attach", 1, 0, 0),
    ("raise", 0, 0, 1),
    ("retry", 0, 0, 0),
]
"""A task holds the lock of the resource in which its exception handler must run. The task's retry
waits for this exception handler.
"""


BLOCKED_LOOP = [("send", 0, 2, 0), ("ask", 0, 2, 0), ("lock", 1, 1, 0), ("lock", 0, 1, 0)]
"""A coroutine asks its own module a query, whose handler takes a lock. Then the coroutine blocks
the thread of both in a wait for this lock.
"""


ANSWERED_WITHIN = [
    ("ask", 0, 2, 0),
    ("send", 0, 0, 0),
    ("send", 0, 2, 0),
    ("ask", 0, 2, 0),
    ("await", 0, 0, 0),
    ("wait", 0, 1, 0),
]
"""A coroutine waits in a cycle that ends when its slot is lent. A query within the wait is handled
first. The end of this query starts the next search.
"""


@given(steps)
@example(KEPT_FOR_A_RETRY)
@example(BLOCKED_LOOP)
@example(ANSWERED_WITHIN)
@settings(max_examples=lives(20, soak=10_000))
def test_troubled_life_ends_with_nothing_left(taken: Steps) -> None:
    assert_everything_ends(Troubled().live(taken))


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(4, soak=1_000))
def test_life_of_all_constructs_ends_with_nothing_left(seed: int) -> None:
    life = Mixed()
    life.go_on(seed, lives(100, soak=300))
    life.end()
