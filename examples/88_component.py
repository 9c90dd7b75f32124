"""A joint with ports and a region moves to its target, in virtual time."""

from dataclasses import dataclass

from tca_behaviours.activities import Application, VirtualBaton
from tca_behaviours.activities.components import Component, connect


@dataclass
class JointData:
    position: float = 0.0
    target: float = 0.0


class Joint(Component[JointData]):
    def __init__(self, name: str) -> None:
        super().__init__(name, JointData, period=0.02, estimate=0.0001)
        self.target = self.input("target", float, self.take_target)
        self.position = self.output("position", float)
        movement = self.region("movement", period=0.02, estimate=0.0001)
        stopped = movement.state("stopped")
        moving = movement.state("moving", activity=self.move, period=0.01, estimate=0.0002)
        stopped.to(moving, on="move")
        moving.to(stopped, when=self.is_there)

    def take_target(self, value: float) -> None:
        self.data.target = value
        self.post("move")

    def move(self) -> None:
        self.data.position = min(self.data.target, self.data.position + 0.01)
        self.position.set(self.data.position)

    def is_there(self) -> bool:
        return self.data.position == self.data.target


class Panel(Component[list[float]]):
    def __init__(self) -> None:
        super().__init__("panel", list, period=0.25, estimate=0.0001)
        self.x = self.input("x", float, self.take_x)

    def take_x(self, value: float) -> None:
        print(f"x = {value:.2f} m")


if __name__ == "__main__":
    joint, panel = Joint("x"), Panel()
    connect(joint.position, panel.x)
    baton = VirtualBaton()
    with Application("wall robot", [joint, panel], baton=baton).running():
        joint.target.put(0.5)
        baton.run(0.3)
        print(joint.regions["movement"].current)
        baton.run(0.7)
        print(joint.regions["movement"].current)
