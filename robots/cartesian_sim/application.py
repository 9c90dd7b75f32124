"""The components of cleaning.toml, connected: made by tca generate.

Do not change this file: changes would be lost.
"""
# isort: skip_file

from contextlib import suppress
from threading import Event
from typing import Any

from tca_behaviours.activities import Application
from tca_behaviours.activities.components import Component, connect
from robots.cartesian_sim.device import Device
from robots.cartesian_sim.guide import Guide
from robots.cartesian_sim.joint import Joint
from robots.cartesian_sim.generated import JointData


class Components:
    """The components of cleaning."""

    def __init__(self) -> None:
        self.device = Device("device")
        self.x = Joint("x", lambda: JointData(length=2.0))
        self.y = Joint("y", lambda: JointData(length=1.2))
        self.tool = Joint("tool", lambda: JointData(length=0.2))
        self.guide = Guide("guide")
        self.all: list[Component[Any]] = [
            self.device,
            self.x,
            self.y,
            self.tool,
            self.guide,
        ]
        connect(self.device.sensed_x, self.x.sensed)
        connect(self.device.sensed_y, self.y.sensed)
        connect(self.device.sensed_tool, self.tool.sensed)
        connect(self.x.drive, self.device.drive_x)
        connect(self.x.position, self.guide.x)
        connect(self.y.drive, self.device.drive_y)
        connect(self.y.position, self.guide.y)
        connect(self.tool.drive, self.device.drive_tool)
        connect(self.tool.position, self.guide.tool)
        connect(self.guide.target_x, self.x.target)
        connect(self.guide.target_y, self.y.target)
        connect(self.guide.target_tool, self.tool.target)


def main() -> None:
    """Run the application until Ctrl-C, and print the changes of its regions."""
    components = Components().all
    for component in components:
        for region in component.regions.values():
            region.on_transition(print)
    with suppress(KeyboardInterrupt), Application("cleaning", components).running():
        Event().wait()


if __name__ == "__main__":
    main()
