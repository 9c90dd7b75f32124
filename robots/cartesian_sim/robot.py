"""The whole robot in one module: components, their application, its manager and the operator."""

from robots.cartesian_sim.application import Components
from robots.cartesian_sim.drawing import draw
from robots.cartesian_sim.operator import CONTROLS, Operator
from tca_behaviours.activities import Application
from tca_behaviours.activities.manager import Manager
from tca_module import Module
from tca_module.link.opening import CentralAddress

NAME = "cleaning robot"


class CleaningRobot:
    """A robot that is connected to one central."""

    def __init__(self, central: CentralAddress = None) -> None:
        self.components = Components()
        self.application = Application(NAME, self.components.all)
        self.module: Module = Operator(self.components).module(central)
        self.manager = Manager(self.application, controls=CONTROLS, picture=self.picture)
        self.manager.handle_in(self.module)

    def picture(self) -> str:
        """Draw the visible state as SVG; empty before the first step."""
        scene = self.components.device.scene.value
        return draw(scene) if scene else ""
