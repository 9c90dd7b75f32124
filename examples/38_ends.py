"""Declare how tasks may end: an egg is boiled, skipped, spoilt, or taken off the stove.

Output::

    egg: boiled, 4 minutes
    stone: skipped, not an egg
    old egg: spoilt, crack
    ostrich egg: taken off, the guests have gone
"""

from tca_module import Command, Effect, Failure, LifeCycle, Module, Party, Task, Transition, connect
from tca_module.errors import TaskFailed, TaskKilled
from tca_module.testing import LocalCentral

BOILING = LifeCycle(
    "boiling",
    [
        Transition("begin", "ordered", "on the stove"),
        Transition("serve", "on the stove", "boiled"),
        Transition("skip", "on the stove", "skipped"),
        Transition("crack", "on the stove", "spoilt"),
        Transition("call off", "on the stove", "called off", Party.CLIENT),
        Transition("take off", "called off", "taken off", effect=Effect.STOP),
    ],
    initial="ordered",
    done=["boiled", "skipped"],
    cancelled=["taken off", "spoilt"],
)
BOIL = Command("boil", str, result=str, life_cycle=BOILING)
CRACK = Failure("crack")  # a failure with the name of a transition makes it

stove = Module("stove")


@stove.handles(BOIL)
def boil(task: Task, food: str) -> str:
    if food == "stone":
        task.take("skip")  # made when the handler returns
        return "not an egg"
    if food == "old egg":
        raise CRACK(text="it was old")
    task.sleep(0 if food == "egg" else 60)
    return "4 minutes"


if __name__ == "__main__":
    with LocalCentral() as central, connect("cook", central) as cook:
        stove.central = central
        with stove.running():
            for food in ["egg", "stone", "old egg", "ostrich egg"]:
                boiling = cook.command(BOIL, food)
                if food == "ostrich egg":
                    boiling.wait_for_state("on the stove")
                    boiling.cancel("the guests have gone")
                try:
                    text = boiling.result()
                except TaskKilled as killed:
                    text = killed.why.removesuffix(" (by cook)")
                except TaskFailed as failed:
                    text = failed.failure
                print(f"{food}: {boiling.state}, {text}")
