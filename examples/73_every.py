"""Do something every 0.1 s while a program runs: a callback of its module sends the temperature."""

from itertools import count

from tca_module import Callback, Inform, Module, Task

TEMPERATURE = Inform("temperature", int)

oven, display = Module("oven"), Module("display")
degrees = count(178)


@oven.every(0.1)
def measure(callback: Callback) -> None:
    now = next(degrees)
    callback.inform(TEMPERATURE, now)
    if now == 180:
        callback.cancel()


@display.handles(TEMPERATURE)
def show(_: Task, degrees: int) -> None:
    print(degrees, "degrees")
    if degrees == 180:
        oven.stop()


if __name__ == "__main__":
    with display.running():
        oven.run()  # until oven.stop(), Ctrl-C or SIGTERM
