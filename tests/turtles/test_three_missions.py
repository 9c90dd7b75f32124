"""The three missions over a network that loses half of all datagrams, without processes, for many
seeds.
"""

from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from turtles.checkpoints import EXPECTED
from turtles.lossy import LossyNetwork

from robots.turtle_sim.missions.three_turtles import MISSIONS
from tca_behaviours.missions import Mission

Step = tuple[str, dict[str, Any]]
PERIOD = 0.1
"""Seconds between two checks of a status."""


class Recorder:
    """A mission that records its actions. The three missions have no branches."""

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def __getattr__(self, task: str) -> Any:
        return lambda **parameters: self.steps.append((task, parameters))


class Agent:
    """A robot that plays one mission on a network. The seed decides its travel times."""

    def __init__(
        self, name: str, network: LossyNetwork, visits: list[tuple[str, str, Any]]
    ) -> None:
        self.name, self.network, self.visits = name, network, visits
        self.table = network.tables[name]
        recorder = Recorder()
        MISSIONS[name](cast("Mission", recorder))
        self.steps = recorder.steps
        network.at(network.chance.uniform(0.0, 5.0), self.next_step)

    def next_step(self) -> None:
        if self.steps:
            task, parameters = self.steps.pop(0)
            getattr(self, task)(**parameters)

    def SetStatusSync(self, status: int) -> None:  # noqa: N802 - as the task is called
        self.table.set(status)
        self.next_step()

    def WaitForStatusSync(self, partner: str, status: int) -> None:  # noqa: N802
        if self.table.status(partner) == status:
            self.next_step()
        else:
            self.network.at(PERIOD, lambda: self.WaitForStatusSync(partner, status))

    def GoTo(self, goal_x: float, goal_y: float) -> None:  # noqa: N802
        self.visits.append(("left for", self.name, (goal_x, goal_y)))
        self.network.at(
            self.network.chance.uniform(0.0, 5.0), lambda: self.arrive((goal_x, goal_y))
        )

    def arrive(self, goal: tuple[float, float]) -> None:
        self.visits.append(("came to", self.name, goal))
        self.next_step()


@given(st.integers(0, 10**9))
def test_three_missions_pass_checkpoints_in_order(seed: int) -> None:
    play(seed, loss=0.5)


@pytest.mark.parametrize("loss", [0.0, 0.9])
def test_three_missions_keep_order_at_any_datagram_loss(loss: float) -> None:
    play(seed=1, loss=loss)


def play(seed: int, loss: float) -> None:
    network, visits = LossyNetwork(list(MISSIONS), seed, loss), list[tuple[str, str, Any]]()
    agents = [Agent(name, network, visits) for name in MISSIONS]
    network.run(lambda: not any(agent.steps for agent in agents))
    assert visits == EXPECTED
