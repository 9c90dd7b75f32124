"""A mission that fails on its way is started again, and leaves out what it has completed."""

import tempfile
from pathlib import Path

from tca_behaviours.missions import (
    ConditionIsCompleted,
    ConditionVerified,
    Environment,
    Mission,
    MissionTaskFailed,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
)


class Camera(Environment):
    film, photographs = 2, 0


class Photograph(OnceTask[Camera]):
    place: str

    def iterate(self) -> None:
        if self.env.photographs == self.env.film:
            raise self.failed("the film is full")
        if self.env.photographs == 4:
            self.sleep(60)  # it waits for the end of the rain
        self.env.photographs += 1
        print("photograph", self.place)


class WaitForRain(PeriodicTask[Camera]):
    def iterate(self) -> Status:
        return Status.COMPLETED if self.env.photographs == 4 else Status.RUNNING


def patrol(mission: Mission) -> str:
    rain = mission.WaitForRain(foreground=False)
    mission.add_condition(ConditionIsCompleted(rain, "it rains"))
    try:
        for number in range(1, 10):
            mission.repeatable_step(f"gate {number}", mission.Photograph, place=f"gate {number}")
            mission.repeatable_step(f"pond {number}", mission.Photograph, place=f"pond {number}")
    except ConditionVerified as interruption:
        return str(interruption)
    return "done"


def run(checkpoint: Path) -> None:
    with Mission("camera", name="patrol", checkpoint=checkpoint) as mission:
        mission.step("clean", print, "clean the lens")
        print("patrol:", mission.repeatable_step("patrol", patrol, mission))


if __name__ == "__main__":
    camera = Camera()
    server = TaskServer("camera", camera, tasks=[Photograph, WaitForRain])
    with server.running(), tempfile.TemporaryDirectory() as folder:
        try:
            run(Path(folder, "patrol.steps"))
        except MissionTaskFailed as failed:
            print(failed.text)
        camera.film = 10
        run(Path(folder, "patrol.steps"))
