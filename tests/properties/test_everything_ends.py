"""Random lives full of trouble come to an end: when each handler has returned, all are resumed and time has passed,
nothing is left. No wait for ever is overlooked, whoever keeps what others need, and what makes a robot safe gets in.
"""

import pytest
from central.player import point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.test_deadlocks import HANDLED, Blocking

from tca_wire import headers
from tca_wire.parts import Attachment
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Role, Scope

MENDERS = {"b": ("exception handler mend",), "d": ("exception handler save", "command park")}
FAILURES = ("slipped", "timeout", "deadlock", "")
STEPS = ["send"] * 5 + ["ask", "wait", "lock", "lock", "constrain", "return", "return", "return", "kill", "suspend"]
STEPS += ["fail", "raise", "retry", "parting", "attach", "attach", "deadline", "kill others"]
steps = st.lists(st.tuples(st.sampled_from(STEPS), *[st.integers(0, 50)] * 3), max_size=40)
QUIET = 6  # rounds after which nothing comes any more: central may be slow to look


class Troubled(Blocking):
    """Modules that block, fail, and have their failures handled by others that block."""

    handled = HANDLED | {name: HANDLED.get(name, ()) + menders for name, menders in MENDERS.items()}

    def do(self, what: str, a: int, b: int, c: int) -> None:
        """One handler, the user or the operator does something."""
        free, tasks = self.free(), [TaskId(task) for task in self.central.tree.tasks]
        who = free[a % len(free)] if free else None
        task = tasks[b % len(tasks)] if tasks else TaskId(0)
        match what:
            case "fail" if who is not None:
                assert who.slot
                is_reissued = who.role is Role.EXCEPTION and b % 2 == 0
                self.fail(who.slot.id.decode(), FAILURES[c % 3], who.given_as, reissue=is_reissued)
            case "raise" if task:
                self.receive("operator", headers.Raise(self.number("operator"), task, FAILURES[c % 3]))
            case "retry" if task:
                self.receive("operator", headers.Retry(self.number("operator"), task))
            case "parting" if task:
                self.send("operator", ("move", "park", "step")[c % 3], under=task, when_killed=True)
            case "attach":
                attachment = Attachment(FAILURES[a % 4], ("mend", "save")[c % 2], c % 3)
                where = TaskId(0) if b % 3 == 0 else task
                self.receive("operator", headers.Attach(self.number("operator"), attachment, where))
            case "deadline" if task:
                at = point(task, list(Moment)[c % 6])
                self.receive("operator", headers.Deadline(self.number("operator"), at, a))
            case "kill others" if task:
                scope = (Scope.DESCENDANTS, Scope.SIBLINGS)[c % 2]
                self.receive("operator", headers.Kill(self.number("operator"), task, "", scope))
            case _:
                super().do(what, a, b, c)

    def end(self) -> None:
        """Each handler returns, all are resumed, and time passes, until nothing more comes."""
        quiet = 0
        while quiet < QUIET:
            for task in [task for task in self.central.tree.tasks.values() if task.suspended]:
                self.receive("operator", headers.Suspend(self.number("operator"), TaskId(task.id), resume=True))
            for claim in list(self.central.claims.values()):
                if claim.holder is None and not claim.slot.waits:
                    self.receive(claim.slot.id.decode(), headers.GiveUp(claim.number))
            free = self.free()
            if free:
                assert free[0].slot
                self.reply(free[0].slot.id.decode(), free[0].given_as)
            self.tick(10.0)
            quiet = 0 if free else quiet + 1


def check(taken: list[tuple[str, int, int, int]]) -> None:
    life = Troubled(looks=True)
    life.hello("operator")
    life.declare("operator", "command park", "command move", "goal step")
    for step in taken:
        life.do(*step)
        life.tick(1.0)
    life.end()
    left = {task: task.children for task in life.central.tree.tasks.values()}
    waits = [(slot.id, number) for slot in life.central.blocked for number in slot.waits]
    assert not (left or waits or life.central.claims), f"will never end, and nobody has said so: {left} {waits}"


@given(steps)
@settings(max_examples=300, deadline=None)
def test_whatever_happens_everything_ends(taken: list[tuple[str, int, int, int]]) -> None:
    check(taken)


@pytest.mark.soak
@given(steps)
@settings(max_examples=10_000, deadline=None)
def test_everything_ends_in_many_lives(taken: list[tuple[str, int, int, int]]) -> None:
    check(taken)
