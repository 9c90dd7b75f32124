"""The whole robot: components, the application that ticks them, its manager and the operator, in one module."""

from robots.cartesian_sim.application import Components
from robots.cartesian_sim.drawing import HEIGHT, WIDTH, draw
from robots.cartesian_sim.messages import (
    CLEAN,
    DISABLE,
    ENABLE,
    MOVE_JOINT,
    MOVE_TO,
    REFERENCE,
    SET_JOINT_SPEED,
    SET_SPEED,
    STOP,
)  # fmt: skip
from robots.cartesian_sim.operator import Operator
from tca_behaviours.activities import Application
from tca_behaviours.activities.manager import Control, ControlField, Manager
from tca_module import Module
from tca_module.link.opening import CentralAddress

NAME = "cleaning robot"

LENGTHS = {"x": WIDTH, "y": HEIGHT, "tool": 0.2}


def _of_joint(joint: str, length: float) -> list[Control]:
    group = f"joint {joint}"
    position = ControlField("position", length / 2, "m", 0.0, length)
    speed = ControlField("speed", 0.1, "m/s", -0.8, 0.8)
    return [
        Control("move", MOVE_JOINT.name, {"joint": joint}, [position], group),
        Control("set speed", SET_JOINT_SPEED.name, {"joint": joint}, [speed], group),
        Control("stop", SET_JOINT_SPEED.name, {"joint": joint, "speed": 0.0}, group=group),
    ]


CONTROLS = [
    Control("enable", ENABLE.name, group="robot"),
    Control("disable", DISABLE.name, group="robot"),
    Control("reference", REFERENCE.name, group="robot"),
    Control("clean", CLEAN.name, group="robot"),
    Control("stop", STOP.name, group="robot"),
    Control(
        "move to", MOVE_TO.name, group="position",
        fields=[ControlField("x", 1.0, "m", 0.0, WIDTH), ControlField("y", 0.6, "m", 0.0, HEIGHT)],
    ),
    Control("set speed", SET_SPEED.name, group="position", fields=[ControlField("", 0.5, "m/s", 0.01, 0.8)]),
    *(control for joint, length in LENGTHS.items() for control in _of_joint(joint, length)),
]  # fmt: skip


class CleaningRobot:
    """The robot of one central."""

    def __init__(self, central: CentralAddress = None) -> None:
        self.components = Components()
        self.application = Application(NAME, self.components.all)
        self.module: Module = Operator(self.components).module(central)
        self.manager = Manager(self.application, controls=CONTROLS, picture=self.picture)
        self.manager.handle_in(self.module)

    def picture(self) -> str:
        """What is to be seen, as SVG; nothing before the first step."""
        scene = self.components.device.scene.value
        return draw(scene) if scene else ""
