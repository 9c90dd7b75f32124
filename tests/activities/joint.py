"""A joint with the four regions of the paper's figure 4, written by hand."""

import msgspec

from tca_behaviours.activities.components import Component

STEP = 0.01


class Target(msgspec.Struct, frozen=True):
    position: float
    speed: float = 1.0


class JointData(msgspec.Struct):
    position: float = 0.5
    speed: float = 1.0
    target: float = 0.5


class Joint(Component[JointData]):
    """A joint that moves between 0 and 1. First, the joint finds its position by driving to 0."""

    def __init__(self, name: str = "x") -> None:
        super().__init__(name, JointData, period=STEP)
        self.command = self.input("command", str, self.post, keep=8)
        self.target = self.input("target", Target, self.take_target)
        self.position = self.output("position", float)

        limits = self.region("limits", period=STEP)
        inside = limits.state("inside")
        beyond = limits.state("beyond", entry=lambda: self.post("stop"))
        inside.to(beyond, when=lambda: not 0 <= self.data.position <= 1)
        beyond.to(inside, when=lambda: 0 <= self.data.position <= 1)

        referencing = self.region("referencing", period=STEP)
        unreferenced = referencing.state("unreferenced")
        searching = referencing.state("searching", activity=self.search, period=STEP)
        referenced = referencing.state("referenced")
        unreferenced.to(searching, on="reference", needs=["enabling.enabled"])
        searching.to(referenced, on="switch")

        enabling = self.region("enabling", period=STEP)
        disabled, enabled = enabling.state("disabled"), enabling.state("enabled")
        disabled.to(enabled, on="enable")
        enabled.to(disabled, on="disable")

        movement = self.region("movement", period=STEP)
        stopped = movement.state("stopped")
        moving = movement.state("moving", exit=self.publish_position)
        fast = moving.state("fast", activity=self.move_fast, period=STEP, estimate=0.0001)
        slow = moving.state("slow", activity=self.move_slow, period=2 * STEP)
        stopped.to(
            moving, on="move", needs=["enabling.enabled", "referencing.referenced", "limits.inside"]
        )
        fast.to(slow, when=lambda: abs(self.data.target - self.data.position) < 0.1)
        moving.to(stopped, on="stop")
        moving.to(stopped, on="disable")
        moving.to(moving, on="move")

    def take_target(self, target: Target) -> None:
        self.data.target, self.data.speed = target.position, target.speed
        self.post("move")

    def search(self) -> None:
        self.data.position = max(0.0, self.data.position - 0.1)
        if not self.data.position:
            self.post("switch")

    def move_fast(self) -> None:
        self.move(0.05)

    def move_slow(self) -> None:
        self.move(0.02)

    def move(self, step: float) -> None:
        left = self.data.target - self.data.position
        self.data.position += max(-step, min(step, left))
        if abs(left) <= step:
            self.post("stop")

    def publish_position(self) -> None:
        self.position.set(self.data.position)
