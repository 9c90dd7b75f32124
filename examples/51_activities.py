"""Run the activities of a balancing robot on processors.

It prints whether each allocation is schedulable, and changes one while the robot runs. Output::

    one_for_all: not schedulable
      all, every 2 ms: no bound
    automatic: schedulable
      processor 1, every 2 ms: within 1.9 ms
      processor 2, every 20 ms: within 2.7 ms
    maps drawn: True - balanced more often: True
    processors: processor 1, processor 2, mapping
"""

import threading

from tca_behaviours.activities import Application, automatic
from tca_behaviours.activities.components import Component


class Robot(Component[list[str]]):
    """Three regions with one state each. The data lists the turns and steps since the last map."""

    def __init__(self) -> None:
        super().__init__("robot", list)
        self.maps = threading.Semaphore(0)
        for name, activity, period, estimate in (
            ("balance", lambda: self.data.append("a turn"), 0.002, 0.0004),
            ("steer", lambda: self.data.append("a step"), 0.004, 0.0004),
            ("mapping", self.draw_map, 0.02, 0.0009),
        ):
            region = self.region(name, period=0.02, estimate=0.0002)
            region.state("on", activity=activity, period=period, estimate=estimate)

    def draw_map(self) -> None:
        self.data.clear()  # safe: the robot's activities never run at the same time
        self.maps.release()


def print_verdict(application: Application) -> None:
    figures = application.figures()
    periods = {one.name: one.period for one in application.allocation().processors}
    print(f"{application.policy}: {'schedulable' if figures.is_schedulable else 'not schedulable'}")
    for one in figures.processors:
        within = "no bound" if one.bound is None else f"within {one.bound * 1e3:.1f} ms"
        print(f"  {one.name}, every {periods[one.name] * 1e3:g} ms: {within}")


robot = Robot()
application = Application("balancing robot", [robot])
print_verdict(application)
application.allocate(automatic)
print_verdict(application)
with application.running():
    for turn in range(6):
        robot.maps.acquire()
        if turn == 2:
            application.move("robot.mapping.on", "mapping")
ticks = {one.name: one.ticks for one in application.figures().activities}
print(
    "maps drawn:",
    ticks["robot.mapping.on"] >= 6,
    "- balanced more often:",
    ticks["robot.balance.on"] > 6,
)
print("processors:", ", ".join(one.name for one in application.allocation().processors))
