"""Reply from another thread: the handler starts a motor, whose thread ends the command later."""

import queue
import threading
import time

from tca_module import Command, Failure, LaterReply, Module, Task, TaskFailed

MOVE = Command("move", float, result=float)
STALLED = Failure("motor stalled", float)

arm = Module("arm")
jobs: queue.SimpleQueue[tuple[LaterReply[float], float]] = queue.SimpleQueue()


@arm.handles(MOVE)
def move(task: Task, angle: float) -> LaterReply[float]:
    later: LaterReply[float] = task.reply_later()
    jobs.put((later, angle))
    return later


def drive() -> None:
    """The motor's own thread."""
    while True:
        later, angle = jobs.get()
        time.sleep(0.05)
        if later.cancelled:
            later.reply(0.0)
        elif angle > 1.5:
            later.fail(STALLED(angle, "it does not turn that far"))
        else:
            later.reply(angle)


if __name__ == "__main__":
    threading.Thread(target=drive, daemon=True).start()
    with arm.running():
        print("moved to", arm.command(MOVE, 0.5).result())
        try:
            arm.command(MOVE, 2.0).result()
        except TaskFailed as error:
            print(error.failure, error.data)
