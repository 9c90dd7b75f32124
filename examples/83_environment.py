"""The tasks of a rover share its environment, which hears a message. The idle task parks it."""

import threading

from tca_behaviours.missions import Environment, Mission, OnceTask, PeriodicTask, Status, TaskServer
from tca_module import Broadcast, Module, Task

BATTERY = Broadcast("battery", float)


class Rover(Environment):
    place, battery = 0, 1.0

    def __init__(self) -> None:
        super().__init__()
        self.is_parked = threading.Event()

    def attach(self, module: Module) -> None:
        """Called once, with the server's module."""

        @module.handles(BATTERY)
        def hear(_: Task, level: float) -> None:
            self.battery = level

    def close(self) -> None:
        """Called when the server has ended."""
        print("the rover is off")


class Drive(PeriodicTask[Rover]):
    goal: int

    def iterate(self) -> Status:  # the server holds self.env.lock
        self.env.place += 1
        return Status.COMPLETED if self.env.place == self.goal else Status.RUNNING


class Measure(OnceTask[Rover]):
    def iterate(self) -> None:
        self.task.broadcast(BATTERY, 0.5)
        while self.env.battery == 1.0:
            self.sleep(0.02)
        with self.env.lock:  # no other task uses the rover in this block
            print(f"battery {self.env.battery} at {self.env.place}")


class Park(OnceTask[Rover]):
    def iterate(self) -> None:
        print("parked")
        self.env.is_parked.set()


if __name__ == "__main__":
    rover = Rover()
    server = TaskServer("rover", rover, tasks=[Drive, Measure], idle=Park, rate=50)
    with server.running(), Mission("rover") as mission:
        mission.Drive(goal=5)
        mission.Measure()
        rover.is_parked.wait(5)  # the idle task begins 0.2 s after the last one
