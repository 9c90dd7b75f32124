"""Temporal's development server in memory, and a worker. A command is an activity of its own.

A goal is a workflow with three activities.
"""

import asyncio
import itertools
import time
from datetime import timedelta
from typing import Any

from temporalio import activity, workflow
from temporalio.client import Client
from temporalio.worker import Worker

from dev.benchmarks.messages.contestant import (
    SOON,
    Contestant,
    NotThere,
    body_of,
    shares,
    timed,
    until,
)
from dev.benchmarks.messages.processes import free_port, program_path

QUEUE = "bench"
LIMIT: Any = {"start_to_close_timeout": timedelta(seconds=SOON)}


@activity.defn  # type: ignore[untyped-decorator]
async def move(body: bytes) -> None:
    """Do nothing."""
    del body


@workflow.defn(sandboxed=False)
class ThreeMoves:
    """Three commands, one after the other."""

    @workflow.run  # type: ignore[untyped-decorator]
    async def run(self, body: bytes) -> None:
        for _ in range(3):
            await workflow.execute_activity(move, body, **LIMIT)


def serve(address: str) -> None:
    """Run the worker."""
    asyncio.run(_serve(address))


async def _serve(address: str) -> None:
    client = await Client.connect(address)
    await Worker(client, task_queue=QUEUE, activities=[move], workflows=[ThreeMoves]).run()


class Temporal(Contestant):
    """Client, server, worker."""

    def start(self) -> None:
        address = f"127.0.0.1:{(port := free_port())}"
        program = (program_path("temporal"), "server", "start-dev", "--headless")
        where = ("--ip", "127.0.0.1", "--port", port, "--log-level", "never")
        self.broker = self.children.program(*program, *where, cwd=self.folder)
        self.loop, self.ids = asyncio.new_event_loop(), itertools.count()
        until(lambda: self._connect(address))
        self.children.serve(serve, address)

    def _connect(self, address: str) -> None:
        try:
            self.client = self._run(Client.connect(address))
        except RuntimeError as error:
            raise NotThere("temporal does not answer") from error

    def _run(self, coroutine: Any) -> Any:
        return self.loop.run_until_complete(coroutine)

    def ready(self) -> None:
        self.commands(1)

    def _call(self, kind: Any, what: Any, **options: Any) -> Any:
        return kind(what, body_of(100), id=f"{next(self.ids)}", task_queue=QUEUE, **options)

    async def _commands(self, number: int) -> list[float]:
        times = []
        for _ in range(number):
            begin = time.perf_counter()
            await self._call(self.client.execute_activity, move, **LIMIT)
            times.append(time.perf_counter() - begin)
        return times

    async def _together(self, number: int) -> None:
        await asyncio.gather(*map(self._commands, filter(None, shares(number))))

    def commands(self, number: int) -> list[float]:
        return list(self._run(self._commands(number)))

    def commands_open(self, number: int) -> None:
        self._run(self._together(number))

    def goals(self, number: int) -> list[float]:
        return timed(
            number, lambda: self._run(self._call(self.client.execute_workflow, ThreeMoves.run))
        )
