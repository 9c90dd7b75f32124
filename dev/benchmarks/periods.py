"""How well periodic tasks keep time: one server, many tasks at one rate.

    python -m dev.benchmarks.periods [--tasks 1,10,100] [--rate 10] [--seconds 10] [--rounds 5]

Each task is a small controller: at its rate it does a little arithmetic on numbers of the
environment. The benchmark measures how late each iteration starts, without the first second.
"""

import math
import statistics
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from dev.benchmarks import central, options_of
from tca_behaviours.missions import Environment, PeriodicTask, Status, TaskServer
from tca_behaviours.missions.serving import run
from tca_module import connect
from tca_module.period import Period

_WARM_UP = 1.0  # seconds


class Cart(Environment):
    """The place and speed of a cart."""

    def __init__(self) -> None:
        super().__init__()
        self.place, self.speed = 0.0, 0.0
        #: The times at which iterations began, and at which they were due, by thread.
        self.begins: dict[int, list[float]] = defaultdict(list)
        self.dues: dict[int, list[float]] = defaultdict(list)


class Steer(PeriodicTask[Cart]):
    """Steer a cart towards a moving place."""

    def iterate(self) -> Status:
        now = time.monotonic()
        env = self.env
        env.begins[threading.get_ident()].append(now)
        wanted = math.sin(now)
        env.speed = max(-1.0, min(1.0, 2.0 * (wanted - env.place)))
        env.place += env.speed * self.task_period
        return Status.RUNNING


def measured(cart: Cart) -> type[Period]:
    """Return periods that record when iterations are due."""

    class Measured(Period):
        def __init__(self, start: float, seconds: float) -> None:
            super().__init__(start, seconds)
            cart.dues[threading.get_ident()].append(start)

        def next(self, now: float, seconds: float) -> float:
            due = super().next(now, seconds)
            cart.dues[threading.get_ident()].append(due)
            return due

    return Measured


def play(address: str, tasks: int, rate: float, seconds: float) -> tuple[list[float], int, float]:
    """Return the delays of iterations in milliseconds, the overruns, and the processor's share of a
    core.
    """
    cart = Cart()
    vars(run)["Period"] = measured(cart)
    server = TaskServer("cart", cart, [Steer], rate=rate, capacity=tasks + 2, central=address)
    steer: Any = server.definitions["Steer"]
    with server.running(), connect("bench", address) as user:
        for _ in range(tasks):
            user.command(steer.message, steer.parameters(foreground=False), sequential=False)
        while len(cart.begins) < tasks:
            time.sleep(0.05)
        before = time.process_time()
        time.sleep(_WARM_UP + seconds)
        share = (time.process_time() - before) / (_WARM_UP + seconds)
        missed = sum(one.overruns for one in server.runs)
    first = max(begins[0] for begins in cart.begins.values()) + _WARM_UP
    late = [
        (begin - due) * 1e3
        for thread, begins in cart.begins.items()
        for begin, due in zip(begins, cart.dues[thread], strict=False)
        if begin >= first
    ]
    return late, missed, share


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--tasks", default="1,10,100")
    parser.add_argument("--rate", type=float, default=10)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    head = f"{'tasks':>6} {'median ms':>10} {'p95 ms':>7} {'(range)':>13} {'p99':>6} {'max':>7}"
    print(f"{head} {'overruns':>9} {'processor':>10}")
    for tasks in map(int, options.tasks.split(",")):
        rounds = []
        for _ in range(options.rounds):
            with tempfile.TemporaryDirectory() as folder, central(Path(folder)) as address:
                late, missed, share = play(address, tasks, options.rate, options.seconds)
            steps = statistics.quantiles(map(abs, late), n=100)
            rounds.append((statistics.median(late), steps[94], steps[98], max(late), missed, share))
        middle = [statistics.median(column) for column in zip(*rounds, strict=True)]
        longest, missed = max(one[3] for one in rounds), sum(one[4] for one in rounds)
        p95 = sorted(one[1] for one in rounds)
        spread = f"({p95[0]:.2f}-{p95[-1]:.2f})"
        print(
            f"{tasks:6} {middle[0]:10.2f} {middle[1]:7.2f} {spread:>13} {middle[2]:6.2f}"
            f" {longest:7.1f} {missed:9} {middle[5]:10.0%}"
        )


if __name__ == "__main__":
    main()
