"""RQ with Redis: the worker that does not fork for each job; the client waits for each job's
result.
"""

import sys
from typing import Any

import rq

from dev.benchmarks.messages.contestant import OPEN, SOON, Contestant, body_of, timed
from dev.benchmarks.messages.peers.redis import connected, start_redis
from dev.benchmarks.messages.peers.work import WORKER, move

BRIEFLY = 60


class Rq(Contestant):
    """Client, Redis, worker."""

    def start(self) -> None:
        self.broker, path = start_redis(self.children, self.folder)
        self.queue = rq.Queue(connection=connected(path))
        program = (sys.executable, "-m", "rq.cli", "worker", "--quiet")
        options = ("--worker-class", "rq.SimpleWorker", "--url", f"unix://{path}")
        self.children.program(*program, *options, cwd=self.folder, env=WORKER)

    def ready(self) -> None:
        self.commands(1)

    def _wait(self, job: Any) -> None:
        result = job.latest_result(timeout=int(SOON))
        assert result is not None
        assert result.type is result.Type.SUCCESSFUL

    def commands(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self._wait(self.queue.enqueue(move, body, result_ttl=BRIEFLY)))

    def commands_open(self, number: int) -> None:
        one = rq.Queue.prepare_data(move, (body_of(100),), result_ttl=BRIEFLY)
        for begun in range(0, number, OPEN):
            for job in self.queue.enqueue_many([one] * min(OPEN, number - begun)):
                self._wait(job)

    def goals(self, number: int) -> list[float]:
        body = body_of(100)

        def goal() -> None:
            last = None
            for _ in range(3):
                last = self.queue.enqueue(move, body, depends_on=last, result_ttl=BRIEFLY)
            self._wait(last)

        return timed(number, goal)
