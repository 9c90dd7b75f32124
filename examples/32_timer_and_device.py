"""Callbacks of a module: every tenth of a second, when a device has sent data, and once later."""

import socket
import threading

from tca_module import Callback, Inform, Module, Sender, Task

BATTERY = Inform("battery level", int)

driver, panel = Module("driver"), Module("panel")
device, cable = socket.socketpair()  # or a serial port, a CAN bus, ...
done = threading.Event()


@driver.every(0.1)
def request_level() -> None:
    cable.send(b"level?\n")


def read_level(callback: Callback) -> None:
    """Read what the device has sent, and pass it on."""
    level = int(cable.recv(100))
    callback.inform(BATTERY, level)
    if level <= 80:
        callback.cancel()


def simulate_device() -> None:
    for level in (100, 90, 80):
        device.recv(100)
        device.send(b"%d" % level)


@panel.handles(BATTERY)
def show(_: Task, level: int) -> None:
    print("battery at", level)
    if level == 80:
        panel.after(0.1, leave)


def leave(_: Sender) -> None:
    print("time to go home")
    done.set()


if __name__ == "__main__":
    threading.Thread(target=simulate_device, daemon=True).start()
    driver.on_readable(cable, read_level)
    with panel.running(), driver.running():
        done.wait(10)
