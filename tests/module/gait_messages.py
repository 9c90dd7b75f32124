"""The vocabulary of a small walking robot."""

from dataclasses import dataclass

from tca_module import Broadcast, Command, Failure, Goal, Inform, MultiQuery, Query


@dataclass
class Arc:
    radius: float
    steps: int


@dataclass
class Footfall:
    leg: int
    height: float


WALK = Goal("walk", Arc)
STEP = Goal("step", int)
REST = Goal("rest")
MOVE_LEG = Command("move leg", int, result=Footfall)
STOP = Command("stop")
STANCE = Query("stance", float, reply=list[int])
TEMPERATURE = Query("temperature", reply=float)
HEALTH = MultiQuery("health", reply=str)
POSITION = Inform("position", Arc)
ALARM = Broadcast("alarm", str)
COLLISION = Failure("collision", Footfall)
EXHAUSTED = Failure("exhausted")
