"""The delay of other modules while programs wait for a goal with very many subtasks.

    python -m dev.benchmarks.waits [--sizes 1000,20000,150000] [--seconds 7]

A goal sends commands that all wait for busy legs. In the meantime a program queries another module
again and again: the benchmark shows the longest delay of a reply. First there are no waiters. Then
a client waits in ``wait()``, then the handlers of 1 and of 40 queries. These could cause a
deadlock, so central checks all that they wait for, in slices.
"""

import statistics
import tempfile
import threading
import time
from pathlib import Path

from dev.benchmarks import central, options_of
from tca_module import Client, Command, Goal, Module, Query, Task, Timeout, connect

WALK, MOVE = Goal("walk", int), Command("move", int)
PING, IS_DONE = Query("ping", int, reply=int), Query("is done", int, reply=bool)
PATIENCE = 100.0
HANDLERS = 40


class Crowd:
    """A goal whose commands wait, handlers that wait for the goal, and an unrelated module."""

    def __init__(self, address: str, seconds: float) -> None:
        self.seconds = seconds  #: the time that a handler waits for the goal
        self.may_end = threading.Event()
        self.is_made = threading.Event()
        self.planner, self.stranger = Module("planner", address), Module("stranger", address)
        self.legs = Module("legs", address)
        self.watcher = Module("watcher", address, capacity=HANDLERS)
        self.planner.handles(WALK)(self._walk)
        self.legs.handles(MOVE)(self._move)
        self.stranger.handles(PING)(lambda _, number: number)
        self.watcher.handles(IS_DONE)(self._is_done)

    def _walk(self, task: Task, size: int) -> None:
        for leg in range(size):
            task.command(MOVE, leg, sequential=False)
        self.is_made.set()

    def _move(self, _: Task, leg: int) -> None:
        if leg == 0:
            self.may_end.wait(600)

    def _is_done(self, task: Task, walk: int) -> bool:
        return wait_for(task, walk, self.seconds)


def wait_for(sender: Task | Client, walk: int, seconds: float) -> bool:
    """Wait for a goal; return whether it has ended in time."""
    task = sender.task(walk)
    assert task is not None
    try:
        task.wait(seconds)
    except Timeout:
        return False
    return True


def pings(client: Client, seconds: float) -> list[float]:
    """Return the milliseconds of each query."""
    times, end = [], time.perf_counter() + seconds
    while (begin := time.perf_counter()) < end:
        client.query(PING, 1, timeout=60)
        times.append((time.perf_counter() - begin) * 1e3)
        time.sleep(0.005)
    return times


def wait(address: str, walk: int, seconds: float) -> None:
    with connect("waiter", address, patience=PATIENCE) as client:
        wait_for(client, walk, seconds)


def ask(address: str, walk: int, seconds: float) -> None:
    with connect("asker", address, patience=PATIENCE) as client:
        client.query(IS_DONE, walk, timeout=seconds + 60)


WAITERS = {
    "none": (wait, 0),
    "a client": (wait, 1),
    "a handler": (ask, 1),
    "40 handlers": (ask, HANDLERS),
}


def measure(size: int, seconds: float) -> dict[str, list[float]]:
    with (
        tempfile.TemporaryDirectory() as name,
        central(Path(name), "--journal", f"{name}/journal") as address,
    ):
        crowd, found = Crowd(address, seconds), {}
        with (
            crowd.planner.running(patience=PATIENCE),
            crowd.legs.running(patience=PATIENCE),
            crowd.watcher.running(patience=PATIENCE),
            crowd.stranger.running(patience=PATIENCE),
            connect("user", address, patience=PATIENCE) as user,
        ):
            walk = user.goal(WALK, size).id
            crowd.is_made.wait()
            time.sleep(1.0)
            for title, (target, number) in WAITERS.items():
                threads = [
                    threading.Thread(target=target, args=(address, walk, seconds))
                    for _ in range(number)
                ]
                for thread in threads:
                    thread.start()
                time.sleep(0.5 if number else 0)
                found[title] = pings(user, seconds - 1.0)
                for thread in threads:
                    thread.join()
            crowd.may_end.set()
            if (task := user.task(walk)) is not None:
                task.kill()
    return found


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--sizes", default="1000,20000,150000")
    parser.add_argument("--seconds", type=float, default=7.0)
    arguments = parser.parse_args()
    print(f"{'subtasks':>10}{'waiters':>13}{'median ms':>11}{'p99':>7}{'max':>7}{'max / none':>14}")
    for size in map(int, arguments.sizes.split(",")):
        found = measure(size, arguments.seconds)
        for title, times in found.items():
            times.sort()
            worst = times[-1]
            p99, ratio = times[len(times) * 99 // 100], worst / found["none"][-1]
            median = statistics.median(times)
            print(
                f"{size:>10,}{title:>13}{median:>11.2f}{p99:>7.1f}{worst:>7.1f}{ratio:>14.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
