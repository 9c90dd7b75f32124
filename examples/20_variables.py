"""Shared variables: central keeps the newest value. A slow watcher skips older values."""

import time
from dataclasses import dataclass

from tca_module import Module, Task, Variable


@dataclass
class Position:
    x: float
    y: float


POSITION = Variable("position", Position)
MODE = Variable("mode", str)

sensor, display, operator = Module("position sensor"), Module("display"), Module("operator")
shown: list[float] = []


@display.handles(POSITION)
def show(_: Task, position: Position) -> None:
    """Take longer than the sensor: only the newest position waits."""
    shown.append(position.x)
    time.sleep(0.1)


if __name__ == "__main__":
    with sensor.running(), operator.running():
        sensor.set_variable(POSITION, Position(0.0, 0.0))
        with display.running():  # the display gets the present position
            for step in range(1, 101):
                sensor.set_variable(POSITION, Position(float(step), 0.0), wait=False)
            while not shown or shown[-1] != 100.0:
                time.sleep(0.05)
        print("mode before:", operator.get_variable(MODE, "none"))
        operator.set_variable(MODE, "walking")
        print("mode when it stopped:", operator.swap_variable(MODE, "stopped"))
        print("position:", operator.get_variable(POSITION).x)
        print("shown all 101 positions:", len(shown) == 101)
