"""A mission changes a running task, and goes home when another one takes too long."""

from tca_behaviours.missions import (
    BadParameter,
    Environment,
    Mission,
    MissionTaskFailed,
    PeriodicTask,
    Status,
    TaskServer,
    Timeout,
    parameter,
)


class Cart(Environment):
    place = 0


class Drive(PeriodicTask[Cart]):
    """Drive along the rail. A stone lies at 3 m."""

    goal: int = parameter(0, "Where to, in metres", minimum=0, maximum=10)

    def iterate(self) -> Status:
        if self.env.place < self.goal and self.env.place < 3:
            self.env.place += 1
        elif self.env.place > self.goal:
            self.env.place -= 1
        self.report(f"at {self.env.place} m")
        return Status.COMPLETED if self.env.place == self.goal else Status.RUNNING


if __name__ == "__main__":
    with TaskServer("cart", Cart(), tasks=[Drive], rate=50).running(), Mission("cart") as mission:
        try:
            mission.Drive(goal=11)
        except BadParameter as error:
            print(error)
        drive = mission.start("Drive", goal=6)
        try:
            mission.wait_for_task(drive, timeout=0.5)
        except Timeout:
            mission.update_task(drive, goal=2)
            print("after the update:", mission.wait_for_task(drive).text)
        try:
            mission.Drive(goal=6, task_timeout=0.3)
        except MissionTaskFailed as failed:
            if Status.of(failed.status) is not Status.TIMEOUT:
                raise
            print("home:", mission.Drive(goal=0).text)
