"""An application that other programs watch and change through central."""

import time

from tca_behaviours.activities import Application
from tca_behaviours.activities.central_ports import publish, receive
from tca_behaviours.activities.components import Component
from tca_behaviours.activities.manager import ApplicationMessages, Control, Manager
from tca_module import Inform, Module, Variable, connect
from tca_module.testing import LocalCentral

SWITCH, IS_LIT = Inform("switch", bool), Variable("the lamp is lit", bool)


class Lamp(Component[None]):
    def __init__(self) -> None:
        super().__init__("lamp", lambda: None, estimate=0.0001)
        self.switch = self.input("switch", bool, self.take_switch)
        self.lit = self.output("lit", bool)
        power = self.region("power", period=0.02, estimate=0.0001)
        off, on = power.state("off"), power.state("on", entry=self.turn_on)
        off.to(on, on="switched on")

    def take_switch(self, value: bool) -> None:
        if value:
            self.post("switched on")

    def turn_on(self) -> None:
        self.lit.set(True)


if __name__ == "__main__":
    lamp, module = Lamp(), Module("house")
    application = Application("the house", [lamp])
    buttons = [Control("light on", SWITCH.name, {"": True})]
    Manager(application, controls=buttons).handle_in(module)
    receive(module, SWITCH, lamp.switch)
    publish(module, lamp.lit, IS_LIT)
    with LocalCentral() as central:
        module.central = central
        with module.running(), application.running(), connect("user", central) as user:
            names = ApplicationMessages("the house")
            user.command(names.set_policy, "one_each").result()
            print([one.name for one in application.allocation().processors])
            user.inform(SWITCH, True)
            while not user.get_variable(IS_LIT, False):
                time.sleep(0.02)
            print("the lamp is lit")
