"""NATS: nats-server with nats-py, requests and subjects; one event loop at each end."""

import asyncio
import time
from typing import Any

import nats
import nats.errors

from dev.benchmarks.messages.contestant import (
    COUNT,
    ECHO,
    LISTENERS,
    MARK,
    NotThere,
    body_of,
    check_arrived,
    shares,
    until,
)
from dev.benchmarks.messages.images import Frame, Showing, Viewer
from dev.benchmarks.messages.processes import free_port, program_path

LARGE = "max_payload: 8MB"
"""The most that its makers advise; without it, a message has 1 MB."""


def serve(address: str) -> None:
    """Run the subscription that answers."""
    asyncio.run(_serve(address))


async def _serve(address: str) -> None:
    line = await nats.connect(address)
    await line.subscribe("work", cb=_handler())
    await line.flush()
    await asyncio.Event().wait()


def listen(address: str) -> None:
    """Run the connections that receive a broadcast."""
    asyncio.run(_listen(address))


async def _listen(address: str) -> None:
    for _ in range(LISTENERS):
        line = await nats.connect(address)
        await line.subscribe("tick", cb=_handler())
        await line.flush()
    await asyncio.Event().wait()


def watch(address: str, topic: str, path: str) -> None:
    """Run a viewer."""
    asyncio.run(_watch(address, topic, Viewer(path)))


async def _watch(address: str, topic: str, viewer: Viewer) -> None:
    async def handle(message: Any) -> None:
        viewer(message.data)

    line = await nats.connect(address)
    await line.subscribe(topic, cb=handle)
    await asyncio.Event().wait()


def _handler() -> Any:
    count = 0

    async def handle(message: Any) -> None:
        nonlocal count
        kind = message.data[:1]
        if kind == COUNT:
            count += 1
            return
        await message.respond(message.data if kind == ECHO else str(count).encode())
        count = 0

    return handle


async def _ignore(_: Exception) -> None:
    """Ignore an error that is also raised."""


class Nats(Showing):
    """Client, NATS server and our server, over TCP, the only transport."""

    def start(self) -> None:
        port = free_port()
        large = self.folder / "nats.conf"
        large.write_text(LARGE)
        where = ("-c", large, "-a", "127.0.0.1", "-p", port)
        self.broker = self.children.program(program_path("nats-server"), *where)
        self.loop = asyncio.new_event_loop()
        self.address = f"nats://127.0.0.1:{port}"
        until(lambda: self._connect(self.address))
        self.receiver = self.children.serve(serve, self.address)
        self.children.serve(listen, self.address)

    def _connect(self, address: str) -> None:
        try:
            self.line = self._run(nats.connect(address, allow_reconnect=False, error_cb=_ignore))
        except (OSError, nats.errors.Error) as error:
            raise NotThere("nats-server does not answer") from error

    def _run(self, coroutine: Any) -> Any:
        return self.loop.run_until_complete(coroutine)

    def ready(self) -> None:
        until(self._check_served)
        until(lambda: self.fanout(0))

    def _check_served(self) -> None:
        try:
            self.round_trip(1, 100)
        except (nats.errors.NoRespondersError, nats.errors.TimeoutError) as error:
            raise NotThere("our server is not connected yet") from error

    def round_trip(self, number: int, size: int) -> list[float]:
        return list(self._run(self._round_trips(number, body_of(size))))

    async def _round_trips(self, number: int, body: bytes) -> list[float]:
        times = []
        for _ in range(number):
            begin = time.perf_counter()
            await self.line.request("work", body, timeout=20)
            times.append(time.perf_counter() - begin)
        return times

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        self._run(self._together(number))

    async def _together(self, number: int) -> None:
        body = body_of(100)
        await asyncio.gather(*(self._round_trips(share, body) for share in shares(number) if share))

    def oneway(self, number: int) -> None:
        self._run(self._informs(number))

    async def _informs(self, number: int) -> None:
        body = body_of(100, COUNT)
        for _ in range(number):
            await self.line.publish("work", body)
        check_arrived(number, int((await self.line.request("work", MARK, timeout=20)).data))

    def fanout(self, number: int) -> None:
        self._run(self._broadcast(number))

    async def _broadcast(self, number: int) -> None:
        body, inbox = body_of(100, COUNT), self.line.new_inbox()
        answers = await self.line.subscribe(inbox)
        for _ in range(number):
            await self.line.publish("tick", body)
        await self.line.publish("tick", MARK, reply=inbox)
        try:
            counts = [
                int((await answers.next_msg(20 if number else 0.5)).data) for _ in range(LISTENERS)
            ]
        except (nats.errors.TimeoutError, ValueError) as error:  # no answer, or no subscriber
            raise NotThere("not all listeners are connected yet") from error
        finally:
            await answers.unsubscribe()
        check_arrived(number, *counts)

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.address, topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        self._run(self._show(topic, frame.tobytes()))

    async def _show(self, topic: str, body: bytes) -> None:
        await self.line.publish(topic, body)
        await self.line.flush()

    def stop(self) -> None:
        if hasattr(self, "line"):
            self._run(self.line.close())
        super().stop()
