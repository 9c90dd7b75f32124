"""The data of early tasks, as ``adapt`` makes it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from coordination.delivery_robot import ARM, MOVE_ARM, MOVE_BASE, Play, base, play

from tca_behaviours.coordination import Activity, Continuous, Coordination, Do
from tca_module import Command, Module, Task

Speeds = np.ndarray[Any, np.dtype[np.float64]]
STEER = Command("steer", Speeds)
ACCORDING_TO_PROGRESS = Continuous(0.0, 1.0, utility=lambda candidate: candidate.progress_before)


def drive_and(activity: Activity) -> Coordination:
    """Return a machine in which the base drives to B. Then *activity* always follows."""
    with Coordination("drive", facts={"base": "A"}) as machine:
        to_b, following = machine.state("to B", base("B")), machine.state("following", activity)
        to_b.to(following)
        following.to(machine.final("end"))
    return machine


def make_robot(received: list[tuple[float, Any]]) -> Module:
    """Return a robot whose base reports each quarter of 8 s. Its arm moves until 10 s after its
    last data.
    """
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base")
    def drive(task: Task, _: str) -> None:
        for quarter in (0.25, 0.5, 0.75, 1.0):
            task.sleep(2)
            task.report(quarter)

    def move(task: Task, data: Any) -> None:
        received.append((task.time(), data))
        while request := task.wait_for_request(10):
            received.append((task.time(), request.goal))
            request.accept()

    robot.handles(MOVE_ARM, resource="arm", takes=["update"])(move)
    robot.handles(STEER, resource="arm", takes=["update"])(move)
    return robot


def fails_from(call: int) -> Callable[[str, float, int], str]:
    """Return an ``adapt`` that adds the share to the data. It fails from the given *call* on."""
    calls = list[float]()

    def adapt(data: str, share: float, _: int) -> str:
        calls.append(share)
        if len(calls) >= call:
            raise ValueError(f"no data at {share:g}")
        return f"{data} at {share:g}"

    return adapt


def run_to_the_end(run: Play) -> None:
    """Run until the end. Check that the second activity started early."""
    ran = run.begin()
    run.central.advance(60)
    assert ran.result(timeout=5).kept == 1


def test_adapted_data_is_made_once_per_speed(caplog: pytest.LogCaptureFixture) -> None:
    """If ``adapt`` fails, the task keeps its data, and the failure is logged once."""
    received: list[tuple[float, str]] = []
    activity = Activity(Do(MOVE_ARM, "box B", ARM), adapt=fails_from(2))
    with play(drive_and(activity), ACCORDING_TO_PROGRESS, make_robot(received)) as run:
        run_to_the_end(run)
    assert received == [(2.0, "box B at 0.2"), (8.0, "box B")]
    warnings = [one.message for one in caplog.records if one.name == "tca.coordinator"]
    assert warnings == ['Activity(arm to "box B") keeps its speed: ValueError: no data at 0.5']


def test_adapted_array_is_sent_when_its_elements_change() -> None:
    received: list[tuple[float, Speeds]] = []

    def adapt(speeds: Speeds, share: float, _: int) -> Speeds:
        return speeds * (1.0 if share > 0.5 else 0.5)

    activity = Activity(Do(STEER, np.array([1.0, 2.0]), ARM), adapt=adapt)
    with play(drive_and(activity), ACCORDING_TO_PROGRESS, make_robot(received)) as run:
        run_to_the_end(run)
    assert [(time, speeds.tolist()) for time, speeds in received] == [
        (2.0, [0.5, 1.0]),
        (6.0, [1.0, 2.0]),
    ]
