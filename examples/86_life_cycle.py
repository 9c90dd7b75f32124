"""A life cycle of your own: a flight is paused by its client, and continued by its server."""

from tca_module import (
    GENERAL,
    Command,
    LifeCycle,
    Module,
    Party,
    Refused,
    Task,
    Transition,
    connect,
    ending,
)
from tca_module.testing import LocalCentral

PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("continue", "paused", "running"),
        *ending("paused"),  # a paused task may also complete or fail
    ],
)
FLY = Command("fly", str, life_cycle=PAUSABLE)

drone = Module("drone")


@drone.handles(FLY, takes=["pause"])
def fly(task: Task, place: str) -> None:
    request = task.wait_for_request(10)
    if request and request.transition == "pause":
        print("the drone hovers:", request.why)
        request.accept()
        task.sleep(5.0)
        task.take("continue")
    print("the drone lands at", place)


if __name__ == "__main__":
    with LocalCentral(stepped=True) as central:
        drone.central = central
        with drone.running(), connect("pilot", central) as pilot:
            flying = pilot.command(FLY, "the hill")
            changes = flying.changes()
            flying.wait_for_state("running")
            flying.take("pause", why="a bird")
            central.until_quiet()
            try:
                flying.take("pause")
            except Refused as refused:
                print("refused:", refused)
            central.advance(5.0)
            flying.result()
            print(" > ".join(change.state for change in changes))
