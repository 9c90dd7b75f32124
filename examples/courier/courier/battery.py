"""Know the charge of the battery."""

from courier.messages import CHARGE, CONSUMED
from tca_module import Module, Task


def make_battery(charge: float = 1.0) -> Module:
    battery = Module("battery")

    @battery.handles(CONSUMED)
    def consume(_: Task, part: float) -> None:
        nonlocal charge
        charge = max(0.0, charge - part)

    @battery.handles(CHARGE)
    def tell_charge(_: Task) -> float:
        return charge

    return battery


if __name__ == "__main__":
    make_battery().run()
