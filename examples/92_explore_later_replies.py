"""Explore a module that replies later, with a predicate of your own.

A step ends when the sensor reports that the legs have stopped. The report may come before the step:
then the step never ends.
"""

from tca_module import Command, Inform, LaterReply
from tca_tools.explore import (
    Scenario,
    Script,
    Seen,
    Task,
    World,
    at_most,
    explore,
    never_stuck,
    report,
)

STEP, STOPPED = Command("step"), Inform("stopped")


def under_way(world: World) -> list[Seen]:
    return [seen for seen in world.messages if seen.message == "step" and seen.is_handled]


walking = Scenario("walking", at_most(1, under_way), never_stuck())
legs, sensor, user = walking.module("legs"), walking.module("sensor"), walking.module("user")
legs.resource("contact")


@legs.handles(STEP)
def step(task: Task) -> LaterReply[None]:
    later: LaterReply[None] = task.reply_later()
    task.keep_reply(later, lambda later, _words: later.reply())
    return later


@legs.handles(STOPPED, resource="contact")
def stopped(task: Task) -> None:
    task.use_kept(STEP)


@sensor.does
def feel(me: Script) -> None:
    me.inform(STOPPED)


@user.does
def walk(me: Script) -> None:
    me.command(STEP).wait()


if __name__ == "__main__":
    print(report(explore(walking)))
