"""A balancing robot: its activities are allocated to processors, also while they run."""

import threading

from tca_behaviours.activities import Application, automatic
from tca_behaviours.activities.components import Component


class Robot(Component[list[str]]):
    """Three regions with one state each. The data are the turns and steps since the last map."""

    def __init__(self) -> None:
        super().__init__("robot", list)
        self.maps = threading.Semaphore(0)
        for name, activity, period, estimate in (
            ("balance", self.balance, 0.002, 0.0004),
            ("steer", self.steer, 0.004, 0.0004),
            ("mapping", self.draw_map, 0.02, 0.0009),
        ):
            region = self.region(name, period=0.02, estimate=0.0002)
            region.state("on", activity=activity, period=period, estimate=estimate)

    def balance(self) -> None:
        self.data.append("a turn")

    def steer(self) -> None:
        self.data.append("a step")

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


if __name__ == "__main__":
    robot = Robot()
    application = Application("balancing robot", [robot])
    print_verdict(application)
    application.allocate(automatic)
    print_verdict(application)
    with application.running():
        robot.maps.acquire()  # wait for a map
        application.move("robot.mapping.on", "mapping")
        robot.maps.acquire()
    print("processors:", ", ".join(one.name for one in application.allocation().processors))
