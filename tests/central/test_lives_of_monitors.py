"""Random lives with many monitors. Other tasks wait for the ends of these monitors, and still
everything ends.
"""

import random

from central.player import INTEGER, Player, before, point
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling import lives

from tca_central.model.contexts import trouble_of
from tca_central.model.tasks import Task
from tca_wire.constraints import Constraint, Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass

WAYS = ["send"] * 6 + ["constrain"] * 4 + ["reply"] * 3 + ["fail", "kill", "retry"]
ENDS = (Moment.END_HANDLING, Moment.END_ACHIEVING)


class LifeOfMonitors:
    """A life with goals and commands that never wait for a slot, and with any number of monitors.
    One exception handler handles all failures.
    """

    def __init__(self, seed: int) -> None:
        self.chance = chance = random.Random(seed)
        self.player = player = Player()
        for name, handled in (
            ("planner", "goal walk"),
            ("legs", "command move"),
            ("mender", "exception handler mend"),
        ):
            player.module(name, handled, capacity=12)
        player.module("user")
        player.module("eye", "query seen")
        watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["seen", ""])
        self.request(headers.Register, [watch])
        self.request(headers.Attach, Attachment("", "mend", 2), ROOT, "walk")
        condition = chance.choice([Condition.WHEN_SENT, Condition.WHILE_HANDLING])
        self.request(headers.Tap, condition, "watch", "walk", ROOT, WatchOptions(1000))

    @property
    def tasks(self) -> list[Task]:
        return list(self.player.central.tree.tasks.values())

    def request(self, kind: type, *arguments: object) -> None:
        self.player.request("user", kind, *arguments)

    def constraint(self, held: int) -> Constraint:
        """Return a random constraint, most often on the end of a monitor."""
        monitors = [
            task for task in self.tasks if task.is_background and self.chance.random() < 0.7
        ] or self.tasks
        return before(
            point(self.chance.choice(monitors).id, self.chance.choice(ENDS)),
            point(held, self.chance.choice(list(Moment))),
        )

    def do(self, way: str) -> None:
        chance, tasks = self.chance, self.tasks
        task = chance.choice(tasks) if tasks else None
        running = [one for one in tasks if one.slot is not None]
        match way:
            case "send":
                message = chance.choice(["walk", "move", "watch"])
                wanted = tuple(self.constraint(-1) for _ in tasks[: chance.choice([0, 1, 2])])
                parent = chance.choice([0, *tasks[:3], *tasks])
                under = parent.id if isinstance(parent, Task) else 0
                flags = Flags(chance.choice([0, 0, 1, 4]))
                watch = WatchOptions(1000) if message == "watch" else None
                self.player.send(
                    "user",
                    message,
                    under=under,
                    origin=0,
                    flags=flags,
                    constraints=wanted,
                    watch=watch,
                )
            case "constrain" if task:
                self.request(headers.Constrain, [self.constraint(task.id)])
            case "reply" if running:
                self.reply(chance.choice(running))
            case "fail" if running:
                one = chance.choice(running)
                assert one.slot
                self.player.fail(one.slot.id.decode(), "slip", one.handling_id)
            case "kill" if task:
                self.request(headers.Kill, TaskId(task.id))
            case "retry" if task:
                self.retry(
                    chance.choice([task, *(one for one in running if one.message.name == "mend")])
                )

    def reply(self, task: Task) -> None:
        assert task.slot
        self.player.reply(task.slot.id.decode(), task.handling_id)

    def retry(self, task: Task) -> None:
        """Retry a task. If the task is a running exception handler, let it retry an ancestor of its
        failing task.
        """
        if task.message.name != "mend" or task.slot is None:
            self.request(headers.Retry, TaskId(task.id))
            return
        above = self.chance.choice(list(trouble_of(task).failing.lineage()))
        name = task.slot.id.decode()
        self.player.request(name, headers.Retry, TaskId(above.id), origin=task.handling_id)

    def finish(self) -> None:
        """Kill all monitors under the root, and let all handlers return."""
        tops = [
            task
            for task in self.tasks
            if task.is_background and task.parent is self.player.central.tree.root
        ]
        for top in tops:
            self.request(headers.Kill, TaskId(top.id))
        while running := [one for one in self.tasks if one.slot is not None]:
            self.reply(running[0])


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(15, soak=1_000))
def test_everything_ends_in_lives_full_of_monitors(seed: int) -> None:
    life = LifeOfMonitors(seed)
    for _ in range(80):
        life.do(life.chance.choice(WAYS))
    life.finish()
    assert not life.tasks
