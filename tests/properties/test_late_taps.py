"""Late wiretaps still apply to queued messages. A wiretap is late if it was added, or its listener
got a handler, after the message was queued. The oracle agrees with central in lives full of late
wiretaps.
"""

import random

from central.test_oracle import NO_SMALLER_SEED, JudgedLife
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sampling import lives

from tca_wire.packets import headers
from tca_wire.points import TaskId
from tca_wire.vocabulary import Condition

CHECKED = {
    "planner": ("goal walk", "query where"),
    "legs": ("command move", "command lift"),
    "expert": ("exception handler recover", "exception handler report"),
    "checker": ("command check", "goal survey", "inform note"),
}
"""The checker joins and leaves independently of the modules that it checks."""
MESSAGES = [message for handled in CHECKED.values() for message in handled]
BEFORE = (Condition.BEFORE_HANDLING,) * 4 + (
    Condition.BEFORE_ACHIEVING,
    Condition.BEFORE_PLANNING,
    Condition.WHEN_PLANNED,
    Condition.WHEN_ACHIEVED,
)
STEPS = (
    ["send"] * 8
    + ["reply"] * 6
    + ["tap"] * 6
    + ["remove"] * 4
    + ["join"] * 2
    + ["bye", "lose", "unregister"]
    + [
        "retry",
        "retry",
        "suspend",
        "suspend",
        "kill",
        "fail",
        "attach",
        "constrain",
        "lock",
        "unclaim",
        "unclaim",
        "pass",
        "raise",
        "give up",
    ]
)
FINISHING = ["reply"] * 8 + ["kill", "pass", "unclaim", "join"]
CROWDED = 25


class CheckedLife(JudgedLife):
    """A life with many taps, of messages and of single queued tasks."""

    modules = CHECKED
    messages = MESSAGES

    def join(self, module: str) -> None:
        self.generation += 1
        pool = "all" if module == "legs" else ""
        self.player.module(f"{module}{self.generation}", *self.modules[module], pool=pool)

    def sent_name(self, b: int) -> str:
        return ("move", "walk", "lift", "move", "walk", "where", "check")[b % 7]

    def retry_policy(self, *_: int) -> None:
        return None

    def tap_(self, a: int, b: int, c: int, d: int) -> None:
        condition, listener = (
            BEFORE[a % len(BEFORE)],
            ("check", "check", "survey", "note", "watch")[b % 5],
        )
        watch = self.watch_options(d, b, c, waited_for=True) if listener == "watch" else None
        waiting = [task for task in self.central.tree.tasks.values() if task.queues is not None]
        if waiting and c % 3 == 0:
            self.request(
                headers.Tap, condition, listener, "", TaskId(waiting[d % len(waiting)].id), watch
            )
        else:
            message = ("move", "walk", "recover", "lift", "move")[d % 5]
            self.request(headers.Tap, condition, listener, message, TaskId(0), watch)

    def go_on(self, seed: int, events: int) -> None:
        dice, end = random.Random(seed), self.central.event_count + events
        while self.central.event_count < end:
            name = dice.choice(FINISHING if self.crowd() > CROWDED else STEPS)
            if name == "tap" and len(self.central.taps) > 3:
                name = "remove"
            if name == "join" and len(self.connections()) > 12:
                name = dice.choice(("lose", "bye"))
            self.do(name, *(dice.randrange(1001) for _ in range(4)))


@given(st.integers(0, 1 << 32))
@example(47066)  # an exception handler is spared while its module leaves, then queued again
@settings(max_examples=lives(4, soak=2_000), phases=NO_SMALLER_SEED)
def test_central_agrees_with_oracle_about_late_wiretaps(seed: int) -> None:
    CheckedLife().go_on(seed, lives(300, soak=500))
