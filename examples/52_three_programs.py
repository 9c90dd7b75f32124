"""A robot, its coordinator and a user: each may be a program of its own.

Start ``tca central``. Then start this file with ``robot``, ``coordinator`` and ``user``, each in
its own terminal.
"""

import sys

from tca_behaviours.coordination import (
    COORDINATION_EVENT,
    Activity,
    Agent,
    Coordination,
    Coordinator,
    Discrete,
    Do,
    MachineEvent,
)
from tca_module import Command, Module, Task, connect

HEAT, LAY = Command("heat", str, progress=float), Command("lay", str)
stove, arm = Agent("stove"), Agent("arm")

with Coordination("make tea", facts={"water": "cold"}) as make_tea:
    waiting = make_tea.state("waiting")
    heating = make_tea.state(
        "heating water", Activity(Do(HEAT, "water", stove), makes={"water": "hot"})
    )
    laying = make_tea.state("laying the table", Activity(Do(LAY, "table", arm)))
    waiting.to(heating, on="tea is wanted")
    heating.to(laying)
    laying.to(make_tea.final("served"))

robot = Module("robot")


@robot.handles(HEAT, resource="stove")
def heat(task: Task, what: str) -> None:
    for step in range(1, 11):
        task.sleep(0.05)
        task.report(step / 10)
    print(what, "is hot")


@robot.handles(LAY, resource="arm")
def lay(_: Task, what: str) -> None:
    print(what, "is laid")


coordinator = Coordinator(make_tea, policy=Discrete(0.4))
kitchen = Module("coordinator")
coordinator.handle_in(kitchen)


def make_request() -> None:
    with connect("user", patience=2) as user:
        run = user.command(coordinator.message, coordinator.chart)
        user.broadcast(COORDINATION_EVENT, MachineEvent("make tea", "tea is wanted"))
        print(run.result().state)


if __name__ == "__main__":
    if sys.argv[1:]:
        {"robot": robot.run, "coordinator": kitchen.run, "user": make_request}[sys.argv[1]]()
    else:  # all three in one program
        with robot.running(patience=2), kitchen.running():
            make_request()
