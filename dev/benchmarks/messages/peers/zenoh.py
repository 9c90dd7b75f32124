"""Zenoh with its Python API: a router, queryables and subscribers over TCP. Puts block.

Images are put into its shared memory. Zenoh itself does the same with other large messages.
"""

import json
import threading
from functools import cached_property, partial
from typing import Any

import zenoh

from dev.benchmarks.messages.contestant import (
    COUNT,
    LISTENERS,
    NotThere,
    body_of,
    run_open,
    timed,
    until,
)
from dev.benchmarks.messages.images import ONE, SIZE, THREE, Frame, Viewer
from dev.benchmarks.messages.processes import free_port
from dev.benchmarks.messages.publishing import Publishing

PATIENT = {"congestion_control": zenoh.CongestionControl.BLOCK}
SHARED = 256 << 20
"""The bytes of shared memory for images."""


def opened(endpoint: str, mode: str = "client") -> Any:
    """Return a client session, or the router."""
    settings = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        ("listen" if mode == "router" else "connect") + "/endpoints": [endpoint],
    }.items():
        settings.insert_json5(key, json.dumps(value))
    return zenoh.open(settings)


def route(endpoint: str) -> None:
    """Run the broker."""
    with opened(endpoint, "router"):
        threading.Event().wait()


def serve(endpoint: str) -> None:
    """Run the queryable and the counting subscriber."""
    session = opened(endpoint)
    session.declare_queryable("ping", lambda query: query.reply("ping", query.payload))
    session.declare_subscriber("pose", _counter(session))
    threading.Event().wait()


def listen(endpoint: str) -> None:
    """Run the sessions that receive a broadcast."""
    sessions = [opened(endpoint) for _ in range(LISTENERS)]
    for session in sessions:
        session.declare_subscriber("tick", _counter(session))
    threading.Event().wait()


def watch(endpoint: str, topic: str, path: str) -> None:
    """Run a viewer."""
    viewer, session = Viewer(path), opened(endpoint)
    session.declare_subscriber(topic, lambda sample: viewer(sample.payload.to_bytes()))
    threading.Event().wait()


def _counter(session: Any) -> Any:
    count = 0
    counts = session.declare_publisher("counts", **PATIENT)

    def receive(sample: Any) -> None:
        nonlocal count
        if sample.payload.to_bytes()[:1] == COUNT:
            count += 1
        else:
            counts.put(str(count))
            count = 0

    return receive


class Zenoh(Publishing):
    """Client, router and server."""

    def start(self) -> None:
        self.endpoint = endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.broker = self.children.serve(route, endpoint)
        until(lambda: self._open(endpoint))
        self.receiver = self.children.serve(serve, endpoint)
        self.children.serve(listen, endpoint)
        self.session.declare_subscriber(
            "counts", lambda sample: self.counts.put(sample.payload.to_bytes())
        )
        names = self.pose, self.tick, ONE, THREE
        self.publishers = {name: self.session.declare_publisher(name, **PATIENT) for name in names}

    def _open(self, endpoint: str) -> None:
        try:
            self.session = opened(endpoint)
        except zenoh.ZError as error:
            raise NotThere("the router does not answer") from error

    def ready(self) -> None:
        until(lambda: self._check_answered(b"e"))
        super().ready()

    def _check_answered(self, body: bytes) -> None:
        if not list(self.session.get("ping", payload=body, timeout=1.0)):
            raise NotThere("our server is not connected yet")

    def publisher(self, name: str) -> Any:
        return self.publishers[name].put

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)
        return timed(number, lambda: _first(self.session.get("ping", payload=body)))

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body = body_of(100)
        run_open(number, lambda: partial(_first, self.session.get("ping", payload=body)))

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.endpoint, topic, path)

    @cached_property
    def _memory(self) -> Any:
        return zenoh.shm.ShmProvider.default_backend(SHARED)

    def show(self, topic: str, frame: Frame) -> None:
        wait = zenoh.shm.BlockOn(zenoh.shm.GarbageCollect())
        buffer = self._memory.alloc(SIZE, wait)
        buffer[:] = frame.tobytes()
        self.publishers[topic].put(buffer)

    def stop(self) -> None:
        if hasattr(self, "session"):
            self.session.close()
        super().stop()


def _first(replies: Any) -> None:
    assert next(iter(replies)).ok is not None
