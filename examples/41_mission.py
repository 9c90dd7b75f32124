"""A mission lets a cart drive to and fro until it rains."""

from tca_behaviours.missions import (
    ConditionIsCompleted,
    ConditionVerified,
    Environment,
    Mission,
    PeriodicTask,
    Status,
    TaskServer,
    parameter,
)


class Cart(Environment):
    place, trips = 0.0, 0


class Drive(PeriodicTask[Cart]):
    """Drive along the rail. In the rain the wheels slip."""

    goal: float = parameter(0.0, "Where to, in metres", minimum=0, maximum=10)

    def iterate(self) -> Status:  # called 50 times a second until it returns COMPLETED
        if self.env.place == self.goal:
            print(f"at {self.goal:g} m")
            self.env.trips += 1
            return Status.COMPLETED
        if self.env.trips < 3:  # it rains after the third trip
            self.env.place += max(-1, min(1, self.goal - self.env.place))
        return Status.RUNNING


class WaitForRain(PeriodicTask[Cart]):
    """Wait until it rains."""

    def iterate(self) -> Status:
        return Status.COMPLETED if self.env.trips == 3 else Status.RUNNING


if __name__ == "__main__":
    with (
        TaskServer("cart", Cart(), tasks=[Drive, WaitForRain], rate=50).running(),
        Mission("cart") as mission,
    ):
        mission.Drive(goal=2.0)
        rain = mission.WaitForRain(foreground=False)
        mission.add_condition(ConditionIsCompleted(rain, "it rains"))
        try:
            while True:
                mission.Drive(goal=6.0)
                mission.Drive(goal=1.0)
        except ConditionVerified as interruption:
            print(interruption)
