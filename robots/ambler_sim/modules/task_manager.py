"""The task manager: splits a path into arcs of a course, and reports the progress of the walk."""

from collections.abc import Callable, Iterator

from robots.ambler_sim.geometry import distance
from robots.ambler_sim.messages import (
    CONFIRM_ARC,
    LOSE_PROGRAM,
    TRAVERSE_ARC,
    TRAVERSE_PATH,
    WALKED,
    Path,
    WayWalked,
)
from robots.ambler_sim.planning.gait import pose_on
from robots.ambler_sim.vocabulary import ORIGIN, Arc, Pose
from tca_module import Module, SentTask, Task, Timeout

BETWEEN_REPORTS = 1.0
"""The least number of seconds between two reports of progress."""


class Odometer:
    """Adds up the distances between successive poses, from the origin."""

    def __init__(self) -> None:
        self.metres = 0.0
        self._last = ORIGIN

    def add(self, pose: Pose) -> float:
        """Add the way to *pose*. Returns the metres so far."""
        self.metres += distance(self._last, pose)
        self._last = pose
        return self.metres


def make_module(
    on_walked: Callable[[float], None],
    confirm: Callable[[int], None],
    lose: Callable[[Task, str], None] | None = None,
) -> Module:
    """Make the module. It calls *on_walked* with the metres so far, *confirm* before an arc (1, 2,
    ...), and *lose* to kill and restart a program.
    """
    manager = Module("task manager")
    odometer = Odometer()

    @manager.handles(TRAVERSE_PATH)
    def traverse_path(task: Task, path: Path) -> None:
        arcs = []
        with task.sequence():
            for number, arc in enumerate(course_of(path)):
                if number and path.ask:
                    task.command(CONFIRM_ARC, number)
                arcs.append(task.goal(TRAVERSE_ARC, arc, delay_planning=True))
        report_progress(task, path, arcs, odometer)

    @manager.handles(CONFIRM_ARC, resource="operator")
    def confirm_arc(_: Task, number: int) -> None:
        confirm(number)

    @manager.handles(LOSE_PROGRAM, resource="programs")
    def lose_program(task: Task, name: str) -> None:
        if lose is not None:
            lose(task, name)

    @manager.handles(WALKED, resource="display")
    def walked(_: Task, pose: Pose) -> None:
        on_walked(odometer.add(pose))

    return manager


def report_progress(task: Task, path: Path, arcs: list[SentTask[None]], odometer: Odometer) -> None:
    """Report how far the robot has come, until it arrives.

    The goal's handler runs during the whole walk, because only a running handler can report.
    """
    length, reported = sum(bend.length for bend in path.bends), 0.0
    for arc in arcs:
        while not wait_for_end(arc):
            if odometer.metres != reported:
                reported = odometer.metres
                share = round(min(reported / length, 1.0), 3)
                task.report(WayWalked(f"{reported:.1f} of {length:.1f} m", share))


def wait_for_end(arc: SentTask[None]) -> bool:
    """Wait for the end of an arc, for BETWEEN_REPORTS seconds at most. Returns whether the arc has
    ended.
    """
    try:
        return arc.next_change(timeout=BETWEEN_REPORTS) is None
    except Timeout:
        return False


def course_of(path: Path) -> Iterator[Arc]:
    """Yield the path's pieces, each from the planned end of the one before."""
    start = ORIGIN
    for bend in path.bends:
        arc = Arc(start, bend.curvature, bend.length)
        yield arc
        start = pose_on(arc, arc.length)
