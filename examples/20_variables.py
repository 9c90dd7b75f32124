"""Share values: central keeps the newest one. A slow watcher skips older values."""

import time
from dataclasses import dataclass

from tca_module import Module, Task, Variable, connect


@dataclass
class Position:
    x: float
    y: float


POSITION = Variable("position", Position)
MODE = Variable("mode", str)

display = Module("display")
shown: list[float] = []


@display.handles(POSITION)
def show(_: Task, position: Position) -> None:
    shown.append(position.x)
    time.sleep(0.1)  # slower than the sensor: values between are skipped


if __name__ == "__main__":
    with connect("sensor") as sensor, connect("operator") as operator:
        print("mode:", operator.get_variable(MODE, "none"))
        operator.set_variable(MODE, "walking")
        print("mode before the stop:", operator.swap_variable(MODE, "stopped"))

        sensor.set_variable(POSITION, Position(0.0, 0.0))
        with display.running():  # gets the present position first
            for step in range(1, 101):
                sensor.set_variable(POSITION, Position(float(step), 0.0), wait=False)
            while 100.0 not in shown:
                time.sleep(0.05)
        print("first and last position:", shown[0], shown[-1])
        print("skipped some of 101:", len(shown) < 101)
