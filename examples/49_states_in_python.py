"""A machine of tasks and Python states: it counts its grasps, and gives up after the third."""

from tca_behaviours.missions import Environment, Mission, OnceTask, TaskServer, parameter
from tca_behaviours.missions.charts import FromData, StateMachine, UserData, state


class Look(OnceTask[Environment]):
    """Look for the cup with one eye."""

    eye: str = parameter("left", "Which eye")

    def iterate(self) -> None:
        if self.eye == "right":
            raise self.failed("too dark")
        print("the left eye sees the cup")


class Grasp(OnceTask[Environment]):
    """Grasp the cup."""

    height: float

    def iterate(self) -> None:
        print(f"grasp at {self.height:g}")
        self.sleep(10.0)  # it never gets hold of the cup


@state(outcomes=["again", "enough"])
def count(data: UserData) -> str:
    data.tries += 1
    data.height -= 0.1
    return "again" if data.tries < 3 else "enough"


with StateMachine("fetch", outcomes=["given up"]) as fetch:
    with fetch.concurrence(
        "look",
        until="all ended",
        outcome_map={
            "seen by both": {"left": "completed", "right": "completed"},
            "seen by one": {"left": "completed"},
        },
        default="failed",
    ).on(**{"seen by both": "grasp", "seen by one": "grasp"}):
        fetch.Look("left", eye="left", foreground=False)
        fetch.Look("right", eye="right", foreground=False)
    fetch.Grasp("grasp", server="arm", height=FromData("height")).after(0.1, "count")
    fetch.call(count).on(again="grasp", enough="given up")


if __name__ == "__main__":
    with (
        TaskServer("eyes", Environment(), tasks=[Look]).running(),
        TaskServer("arm", Environment(), tasks=[Grasp]).running(),
        Mission("eyes") as mission,
    ):
        data = {"tries": 0, "height": 0.3}
        end = fetch.run(mission, data=data)
        print(f"{end.outcome} after {data['tries']} grasps")
