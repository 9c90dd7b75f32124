"""A task server offers the tasks of an oven, as classes with parameters. A mission runs them."""

from tca_behaviours.missions import (
    Environment,
    Mission,
    MissionTaskFailed,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    parameter,
)


class Oven(Environment):
    degrees = 20.0
    power = 0.0


class Heat(PeriodicTask[Oven]):
    """Heat the oven."""

    target: float = parameter(180.0, "Where to stop, in degrees", minimum=0, maximum=250)
    power: float = parameter(1.0, "How fast, in degrees a step", minimum=0, maximum=5)

    def initialise(self) -> None:
        if self.env.degrees > self.target:
            raise self.failed(f"it is {self.env.degrees:g} degrees hot already")

    def iterate(self) -> Status:
        self.env.power = self.power
        self.env.degrees += self.env.power
        self.report(f"heated to {self.env.degrees:g} degrees")
        return Status.COMPLETED if self.env.degrees >= self.target else Status.RUNNING

    def terminate(self) -> None:  # called however the run ends
        self.env.power = 0.0
        print("switched off")


class Measure(OnceTask[Oven]):
    """Report how hot it is."""

    def iterate(self) -> None:
        self.report(f"{self.env.degrees:g} degrees")


if __name__ == "__main__":
    server = TaskServer("oven", Oven(), tasks=[Heat, Measure], rate=50.0)
    with server.running(), Mission("oven") as mission:
        print(mission.Measure().text)
        print(mission.Heat(target=26.0).text)
        try:
            mission.Heat(target=250.0, power=0.5, task_timeout=0.1)
        except MissionTaskFailed as failed:
            print(failed)
