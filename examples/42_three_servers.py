"""One mission runs the tasks of three servers until the battery is low."""

from tca_behaviours.missions import (
    ConditionVerified,
    Environment,
    Mission,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    VariableCondition,
)
from tca_module import Variable

BATTERY = Variable("battery", int)


class Truck(Environment):
    place, battery = 0, 100


class Drive(PeriodicTask[Truck]):
    goal: int = 0  # a metre costs 15 percent of the battery

    def iterate(self) -> Status:
        if self.env.battery > 30 or self.goal == 0:
            self.env.battery -= 15
            self.env.place += 1 if self.env.place < self.goal else -1
        self.task.set_variable(BATTERY, self.env.battery)
        self.report(f"at {self.env.place} m")
        return Status.COMPLETED if self.env.place == self.goal else Status.RUNNING


class Lift(OnceTask[Environment]):
    def iterate(self) -> None:
        self.report("lifted")


class Load(OnceTask[Environment]):
    def iterate(self) -> None:
        self.report("loaded")


if __name__ == "__main__":
    with (
        TaskServer("truck", Truck(), tasks=[Drive], rate=50).running(),
        TaskServer("crane", Environment(), tasks=[Lift]).running(),
        TaskServer("hook", Environment(), tasks=[Load]).running(),
        Mission("truck") as truck,
        Mission("crane", beside=truck) as crane,
        Mission("hook", beside=truck) as hook,
    ):
        ends = truck.wait_for_all_tasks([truck.start("Drive", goal=3), crane.start("Lift")])
        print("truck {} and crane {}".format(*(end.text for end in ends)))
        print(hook.Load().text)
        truck.add_condition(VariableCondition(BATTERY, lambda x: x < 35, "the battery is low"))
        try:
            truck.Drive(goal=10)
        except ConditionVerified as interruption:
            print(interruption)
        print(truck.Drive(goal=0).text)
