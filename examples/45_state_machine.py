"""A patrol as a state machine: drive round until a background task sees an intruder."""

from tca_behaviours.missions import (
    Environment,
    Mission,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    parameter,
)
from tca_behaviours.missions.charts import Sequence


class Cart(Environment):
    trips = 0


class Drive(OnceTask[Cart]):
    """Drive to a place."""

    place: str = parameter("the gate", "Where to")

    def iterate(self) -> None:
        self.env.trips += 1
        print(f"drive to {self.place}")
        self.sleep(0.1 if self.env.trips < 3 else 10.0)  # an intruder blocks the third trip


class LookOut(PeriodicTask[Cart]):
    """Wait until an intruder is seen."""

    def iterate(self) -> Status:
        return Status.COMPLETED if self.env.trips >= 3 else Status.RUNNING


class Lights(OnceTask[Cart]):
    """Switch the lights on."""

    def iterate(self) -> None:
        print("an intruder: lights on")


with Sequence("patrol") as patrol:
    with patrol.concurrence():  # ends when one of the two ends, and stops the other
        patrol.LookOut(foreground=False)
        with patrol.sequence("round"):
            gate = patrol.Drive()
            patrol.Drive(place="the pond").on(completed=gate)
    patrol.Lights()


if __name__ == "__main__":
    with (
        TaskServer("cart", Cart(), tasks=[Drive, LookOut, Lights]).running(),
        Mission("cart") as mission,
    ):
        patrol.run(mission)
