"""Celery with Redis for messages and results; one worker without a pool. A goal is a chain."""

import os
import sys
from functools import partial
from typing import Any

import celery

from dev.benchmarks.messages.contestant import OPEN, SOON, Contestant, body_of, run_open, timed
from dev.benchmarks.messages.peers.redis import start_redis

PLACE = "TCA_BENCH_REDIS"
app = celery.Celery(broker=os.environ.get(PLACE), backend=os.environ.get(PLACE))
app.conf.update(
    broker_connection_retry_on_startup=True, worker_prefetch_multiplier=OPEN, result_expires=60
)


@app.task(name="move")  # type: ignore[untyped-decorator]
def move(body: str) -> None:
    """Do nothing."""
    del body


class Celery(Contestant):
    """Client, Redis, worker."""

    def start(self) -> None:
        self.broker, path = start_redis(self.children, self.folder)
        address = f"redis+socket://{path}"
        app.conf.update(broker_url=address, result_backend=address)
        worker = (sys.executable, "-m", "celery", "-A", __name__, "worker", "--pool", "solo")
        still = ("--without-gossip", "--without-mingle", "--without-heartbeat")
        self.children.program(*worker, *still, env={**os.environ, PLACE: address})
        self.body = body_of(100).decode()

    def ready(self) -> None:
        self.commands(1)

    def _begun(self) -> Any:
        return move.delay(self.body)

    def commands(self, number: int) -> list[float]:
        return timed(number, lambda: self._begun().get(timeout=SOON))

    def commands_open(self, number: int) -> None:
        run_open(number, lambda: partial(self._begun().get, timeout=SOON))

    def goals(self, number: int) -> list[float]:
        def done() -> None:
            # A chain that is sent again keeps its id, and so the result of the first time.
            parts = celery.chain(*(move.si(self.body) for _ in range(3)))
            parts.delay().get(timeout=SOON)

        return timed(number, done)
