"""The bound of "plan the next while acting", held against the real central: the same robot, once with its planning delayed
and once planning one ahead, with any durations.
"""

import heapq
from typing import Any

import pytest
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st

from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import overlaps
from tca_tools.analysis.critical_path import critical_path, last_task
from tca_tools.analysis.summary import summary
from tca_tools.run.fold import History
from tca_wire.constraints import Constraint, delay_planning, plan_ahead
from tca_wire.points import THIS, TaskId

DURATIONS = st.lists(st.tuples(st.integers(1, 6), st.integers(1, 6)), min_size=1, max_size=6)


class Robot(Player):
    """A planner, legs and a user. Messages take no time; plans and moves take what *durations* say, step by step."""

    def __init__(self, durations: list[tuple[int, int]], *, looks_ahead: bool) -> None:
        super().__init__()
        self.durations = durations
        self.looks_ahead = looks_ahead
        self.due: list[tuple[float, str, int]] = []
        self.begun: set[int] = set()
        self.steps: list[int] = []
        self.moves: dict[int, int] = {}
        self.module("user")
        self.module("planner", "goal walk", "goal step")
        self.module("legs", "command move")

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        effects = self.event(RequestReceived(self.time, ConnectionId(connection.encode()), header, body))
        return [effect.header for effect in effects if isinstance(effect, Transmit)]

    def run(self) -> History:
        walk = self.task("user", "walk")
        for _ in self.durations:
            self.steps.append(self.task("planner/1", "step", under=walk, constraints=self.order()))
        self.reply("planner/1")
        self.begin()
        while self.due:
            self.time, connection, delivery = heapq.heappop(self.due)
            if connection == "planner/1":
                self.moves[self.task("planner/1", "move", under=delivery)] = self.steps.index(delivery)
            self.reply(connection, delivery)
            self.begin()
        return History.until(self.entries)

    def order(self) -> tuple[Constraint, ...]:
        """What holds back the planning of the next step."""
        if not self.looks_ahead:
            return (delay_planning(THIS),)
        return (plan_ahead(TaskId(self.steps[-1]), THIS),) if self.steps else ()

    def begin(self) -> None:
        """Whoever was given something will have done it after its time."""
        for connection in ("planner/1", "legs/1"):
            for delivery in set(self.delivered(connection)) - self.begun:
                self.begun.add(delivery)
                planning = connection == "planner/1"
                step = self.steps.index(delivery) if planning else self.moves[delivery]
                seconds = self.durations[step][0 if planning else 1]
                heapq.heappush(self.due, (self.time + seconds, connection, delivery))


@given(DURATIONS)
@settings(max_examples=60)
def test_looking_one_step_ahead_saves_what_the_report_said(durations: list[tuple[int, int]]) -> None:
    slow = Robot(durations, looks_ahead=False).run()
    fast = Robot(durations, looks_ahead=True).run()
    found = overlaps(slow, Causes(slow))
    saved = summary(slow).seconds - summary(fast).seconds
    assert sum(overlap.saving for overlap in found) == pytest.approx(saved, abs=1e-6)
    assert sum(overlap.saving for overlap in overlaps(fast, Causes(fast))) == pytest.approx(0.0, abs=1e-6)


@given(DURATIONS, st.booleans())
@settings(max_examples=60)
def test_the_critical_path_is_as_long_as_the_run(durations: list[tuple[int, int]], looks_ahead: bool) -> None:
    run = Robot(durations, looks_ahead=looks_ahead).run()
    task = last_task(run)
    assert task is not None
    path = critical_path(run, Causes(run), task)
    assert sum(step.seconds for step in path.steps) == pytest.approx(summary(run).seconds)
