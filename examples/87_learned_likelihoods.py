"""A coordinator learns from earlier runs what guests want, and begins to make it early."""

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    CoordinationEnd,
    Coordinator,
    Discrete,
    Do,
    Learned,
    count_transitions,
)
from tca_module import Command, Module, Task, Variable
from tca_module.testing import LocalCentral

ASK, MAKE = Command("ask"), Command("make", str)
WANTS_COFFEE = Variable("the guest wants coffee", bool)
waiter, stove = Agent("waiter"), Agent("stove")


def write_machine(counts: dict[tuple[str, str], int]) -> Coordination:
    with Coordination("serve") as serve:
        asking = serve.state("asking", Activity(Do(ASK, None, waiter)))
        coffee = serve.state("making coffee", Activity(Do(MAKE, "coffee", stove)))
        tea = serve.state("making tea", Activity(Do(MAKE, "tea", stove)))
        served = serve.final("served")
        asking.to(coffee, when=WANTS_COFFEE, likelihood=Learned(counts))
        asking.to(tea, likelihood=Learned(counts))
        coffee.to(served)
        tea.to(served)
    return serve


def serve(central: LocalCentral, coordinator: Coordinator, *, coffee: bool) -> CoordinationEnd:
    robot = Module("robot", central)
    coordinator.handle_in(robot)

    @robot.handles(ASK, resource="waiter")
    def ask(task: Task) -> None:
        task.sleep(0.3)
        task.set_variable(WANTS_COFFEE, coffee)
        print("the guest wants", "coffee" if coffee else "tea")
        task.sleep(0.3)  # the waiter walks back

    @robot.handles(MAKE, resource="stove")
    def make(_: Task, drink: str) -> None:
        print("make", drink)

    with robot.running():
        return coordinator.run(robot)


if __name__ == "__main__":
    with LocalCentral() as central:
        for coffee in (True, True, False, True):
            serve(central, Coordinator(write_machine({})), coffee=coffee)
        counts = count_transitions([central.entries], write_machine({}).chart)
        print([count for (state, _), count in counts.items() if state == "asking"])
        learned = Coordinator(write_machine(counts), policy=Discrete(0.5))
        print(serve(central, learned, coffee=True))
