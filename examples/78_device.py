"""Serve a device: a command writes to its cable, and a callback ends it when the device answers."""

import socket
import threading
import time

from tca_module import Command, Failure, LaterReply, Module, Task, TaskFailed

TURN = Command("turn", int, result=int)
STALLED = Failure("stalled", int)

arm = Module("arm")
device, cable = socket.socketpair()  # or a serial port, a CAN bus, ...
turning: list[LaterReply[int]] = []


@arm.handles(TURN)
def turn(task: Task, degrees: int) -> LaterReply[int]:
    cable.send(b"%d\n" % degrees)
    later = task.reply_later()  # the command stays open until later.reply() or later.fail()
    turning.append(later)
    return later


def read_answer() -> None:  # called when the device has sent something
    word, degrees = cable.recv(100).split()
    later = turning.pop()
    if word == b"at":
        later.reply(int(degrees))
    else:
        later.fail(STALLED(int(degrees)))


def simulate_device() -> None:  # it can turn up to 90 degrees
    while degrees := int(device.recv(100)):
        time.sleep(0.05)
        device.send(b"at %d" % degrees if degrees <= 90 else b"stalled 90")


if __name__ == "__main__":
    threading.Thread(target=simulate_device, daemon=True).start()
    arm.on_readable(cable, read_answer, resource="arm")
    with arm.running():
        print("at", arm.command(TURN, 30).result(timeout=5))
        try:
            arm.command(TURN, 120).result(timeout=5)
        except TaskFailed as error:
            print(error.failure, "at", error.data)
