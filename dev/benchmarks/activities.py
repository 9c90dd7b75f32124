"""How well processors keep time, and the cost of passing the baton.

    python -m dev.benchmarks.activities [--activities 50] [--rate 100] [--processors 1,5,50]
    [--seconds 5] [--rounds 5]

Each activity is a small controller: a little arithmetic at its rate. All are due at the same times.
The table shows how late the first activity starts, and how long after its time the last one ends.
Jitter is the distance of an activity's starts from their own median. The last column is the
processor time of a tick beside the activity itself.

With --beside, a thread of the same program computes all the time. --switch sets the interval after
which the interpreter switches threads.
"""

import math
import statistics
import sys
import threading
import time
from collections import defaultdict

from dev.benchmarks import options_of
from tca_behaviours.activities.processing import Baton
from tca_behaviours.activities.processing.schedule import Processor, ScheduledActivity

_WARM_UP = 0.5  # seconds
_computed = [0.0]  # the processor seconds of the computing thread


class Controller:
    """Steers a cart towards a moving place."""

    component = "bench"
    estimate: float | None = None

    def __init__(self, number: int, period: float) -> None:
        self.name = f"a{number}"
        self.period = period
        self._place, self._speed = 0.0, 0.0

    def tick(self) -> None:
        wanted = math.sin(time.monotonic())
        self._speed = max(-1.0, min(1.0, 2.0 * (wanted - self._place)))
        self._place += self._speed * self.period


def play(
    activities: int, processors: int, period: float, seconds: float
) -> tuple[float, float, float, float, float]:
    """Return the first start (p95), the last end (p95), the jitter (median and p99), and the cost
    of a tick.

    The cost is in microseconds, all other figures in milliseconds.
    """
    baton = Baton()
    schedule, began = baton.schedule, defaultdict[str, list[float]](list)
    ended = defaultdict[float, float](float)
    begin, end = schedule.begin, schedule.end

    def recorded_begin(processor: Processor, now: float) -> ScheduledActivity:
        one = begin(processor, now)
        began[one.name].append(now - one.release.due)
        return one

    def recorded_end(now: float, error: str = "") -> None:
        due = schedule.ticked.release.due if schedule.ticked else 0.0
        ended[due] = max(ended[due], now - due)
        end(now, error)

    vars(schedule).update(begin=recorded_begin, end=recorded_end)
    with baton.changing():
        places = [schedule.new_processor(f"p{number}", 0.0) for number in range(processors)]
        for number in range(activities):
            schedule.add(Controller(number, period))
            schedule.put(
                schedule.activity(f"a{number}"), places[number * processors // activities], 0.0
            )
    baton.start()
    time.sleep(_WARM_UP)
    with baton.lock:
        began.clear()
        ended.clear()
    executions = [one.execution for one in schedule.activities.values()]

    def used_seconds() -> float:
        """Return the processor seconds beside the activities and the computing thread."""
        in_activities = sum(one.mean * one.ticks for one in executions)
        return time.process_time() - _computed[0] - in_activities

    used_before = used_seconds()
    time.sleep(seconds)
    baton.stop()
    used = used_seconds() - used_before
    ticks = sum(len(each) for each in began.values())
    off_median = [abs(late - statistics.median(each)) for each in began.values() for late in each]
    first = statistics.quantiles(began["a0"], n=20)[18]
    last = statistics.quantiles(ended.values(), n=20)[18]
    jitter = statistics.quantiles(off_median, n=100)
    return first * 1e3, last * 1e3, jitter[49] * 1e3, jitter[98] * 1e3, used / ticks * 1e6


def compute() -> None:
    """Compute for ever."""
    while True:
        sum(range(1000))
        _computed[0] = time.thread_time()


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--activities", type=int, default=50)
    parser.add_argument("--rate", type=float, default=100)
    parser.add_argument("--processors", default="1,5,50")
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--beside", action="store_true")
    parser.add_argument("--switch", type=float, default=0.005)
    options = parser.parse_args()
    sys.setswitchinterval(options.switch)
    if options.beside:
        threading.Thread(target=compute, daemon=True).start()
    print("processors  first begins p95 ms  last ends p95 ms  jitter median ms     p99  us a tick")
    for processors in map(int, options.processors.split(",")):
        rounds = [
            play(options.activities, processors, 1 / options.rate, options.seconds)
            for _ in range(options.rounds)
        ]
        first, last, median, p99, cost = (
            statistics.median(column) for column in zip(*rounds, strict=True)
        )
        print(f"{processors:10} {first:20.2f} {last:17.2f} {median:17.3f} {p99:7.2f} {cost:10.1f}")


if __name__ == "__main__":
    main()
