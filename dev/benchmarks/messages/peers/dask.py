"""Dask: a scheduler, a worker with one thread, futures. A goal's parts are dependent futures."""

import sys

import distributed

from dev.benchmarks.messages.contestant import SOON, Contestant, body_of, run_open, timed
from dev.benchmarks.messages.peers.work import WORKER, move
from dev.benchmarks.messages.processes import free_port

PLAIN = {"pure": False}


class Dask(Contestant):
    """Client, scheduler, worker."""

    def start(self) -> None:
        address = f"tcp://127.0.0.1:{free_port()}"
        program = (sys.executable, "-m", "distributed.cli.dask_scheduler")
        self.broker = self.children.program(
            *program, "--host", address, "--no-dashboard", "--no-show", cwd=self.folder, env=WORKER
        )
        worker = (sys.executable, "-m", "distributed.cli.dask_worker", address)
        self.children.program(
            *worker, "--nthreads", 1, "--no-nanny", "--no-dashboard", cwd=self.folder, env=WORKER
        )
        self.client = distributed.Client(address, timeout=SOON, set_as_default=False)

    def ready(self) -> None:
        self.client.wait_for_workers(1, timeout=SOON)
        self.commands(1)

    def commands(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self.client.submit(move, body, **PLAIN).result())

    def commands_open(self, number: int) -> None:
        body = body_of(100)
        run_open(number, lambda: self.client.submit(move, body, **PLAIN).result)

    def goals(self, number: int) -> list[float]:
        body = body_of(100)

        def goal() -> None:
            last = self.client.submit(move, body, **PLAIN)
            for _ in range(2):
                last = self.client.submit(move, body, last, **PLAIN)
            last.result()

        return timed(number, goal)

    def stop(self) -> None:
        if hasattr(self, "client"):
            self.client.close(timeout=2)
        super().stop()
