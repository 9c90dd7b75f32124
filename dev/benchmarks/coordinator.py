"""The processor time of a coordinator for one event, by the length of the preview list.

python -m dev.benchmarks.coordinator
"""

import statistics
import time
from collections.abc import Callable
from itertools import pairwise
from unittest.mock import patch

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    Coordinator,
    Discrete,
    Do,
    Policy,
)
from tca_behaviours.coordination.running.run import CoordinationRun
from tca_module import Command, Module, Task, connect
from tca_module.testing import LocalCentral

WORK = Command("work", int, progress=float)
REPORTS = 300


def chain(length: int) -> Coordination:
    """Return activities in a row. Each activity makes a fact that the next activity needs."""
    with Coordination(
        "chain", facts={f"done {place}": False for place in range(length + 1)}
    ) as machine:
        states = [
            machine.state(
                f"state {place}",
                Activity(
                    Do(WORK, place, Agent(f"agent {place % 3}")),
                    needs={f"done {place - 1}": True} if place else {},
                    makes={f"done {place}": True},
                ),
            )
            for place in range(length + 1)
        ]
        states.append(machine.final("end"))
        for state, following in pairwise(states):
            state.to(following)
    return machine


def cost_of_events(length: int, policy: Policy | None) -> float:
    """Return the coordinator's microseconds for one report of the current activity."""
    times: list[float] = []
    advance: Callable[[CoordinationRun], None] = vars(CoordinationRun)["_advance"]

    def measured(run: CoordinationRun) -> None:
        began = time.thread_time()
        advance(run)
        times.append(time.thread_time() - began)

    with LocalCentral(stepped=True) as central:
        robot, module = Module("robot", central), Module("coordinator", central)

        @robot.handles(WORK)
        def work(task: Task, _: int) -> None:
            for report in range(REPORTS):
                task.sleep(0.1)
                task.report(report / REPORTS)
            task.sleep(1000)

        coordinator = Coordinator(chain(length), policy=policy)
        coordinator.handle_in(module)
        with (
            patch.object(CoordinationRun, "_advance", measured),
            robot.running(),
            module.running(),
            connect("user", central) as user,
        ):
            user.command(coordinator.message, coordinator.chart)
            central.advance(REPORTS / 10 + 1)
    return 1e6 * statistics.median(times)


if __name__ == "__main__":
    print("preview list  without a policy, us  with one, us  us a state")
    for length in (1, 10, 100, 1000):
        plain, ahead = cost_of_events(length, None), cost_of_events(length, Discrete(0.5))
        print(f"{length:12}  {plain:20.0f}  {ahead:12.0f}  {(ahead - plain) / length:10.1f}")
