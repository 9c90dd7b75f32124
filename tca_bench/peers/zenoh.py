"""Zenoh with its Python API: a router, queryables and subscribers, over TCP; puts that wait rather than drop."""

import json
import queue
import threading
from collections import deque
from typing import Any

import zenoh

from tca_bench.contestant import (
    COUNT,
    LISTENERS,
    MARK,
    OPEN,
    Contestant,
    NotThere,
    body_of,
    check_arrived,
    timed,
    until,
)
from tca_bench.processes import free_port

PATIENT = {"congestion_control": zenoh.CongestionControl.BLOCK}


def opened(endpoint: str, mode: str = "client") -> Any:
    """A session that is one end of the router, or the router itself."""
    settings = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        ("listen" if mode == "router" else "connect") + "/endpoints": [endpoint],
    }.items():
        settings.insert_json5(key, json.dumps(value))
    return zenoh.open(settings)


def route(endpoint: str) -> None:
    """The broker."""
    with opened(endpoint, "router"):
        threading.Event().wait()


def serve(endpoint: str) -> None:
    """What answers, and what counts."""
    session = opened(endpoint)
    session.declare_queryable("ping", lambda query: query.reply("ping", query.payload))
    session.declare_subscriber("pose", _counter(session))
    threading.Event().wait()


def listen(endpoint: str) -> None:
    """The sessions that hear a broadcast."""
    sessions = [opened(endpoint) for _ in range(LISTENERS)]
    for session in sessions:
        session.declare_subscriber("tick", _counter(session))
    threading.Event().wait()


def _counter(session: Any) -> Any:
    count = 0
    told = session.declare_publisher("told", **PATIENT)

    def hear(sample: Any) -> None:
        nonlocal count
        if sample.payload.to_bytes()[:1] == COUNT:
            count += 1
        else:
            told.put(str(count))
            count = 0

    return hear


class Zenoh(Contestant):
    """Client, router, server."""

    def start(self) -> None:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.children.serve(route, endpoint)
        until(lambda: self._open(endpoint))
        self.children.serve(serve, endpoint)
        self.children.serve(listen, endpoint)
        self.told = queue.SimpleQueue[bytes]()
        self.session.declare_subscriber("told", lambda sample: self.told.put(sample.payload.to_bytes()))
        self.topics = {key: self.session.declare_publisher(key, **PATIENT) for key in ("pose", "tick")}

    def _open(self, endpoint: str) -> None:
        try:
            self.session = opened(endpoint)
        except zenoh.ZError as error:
            raise NotThere("the router does not answer") from error

    def ready(self) -> None:
        until(lambda: self._check_answered(b"e"))
        until(lambda: self._check_heard("pose", 1))
        until(lambda: self._check_heard("tick", LISTENERS))

    def _check_answered(self, body: bytes) -> None:
        if not list(self.session.get("ping", payload=body, timeout=1.0)):
            raise NotThere("our server is not connected yet")

    def _check_heard(self, key: str, ears: int) -> None:
        self.topics[key].put(MARK)
        try:
            for _ in range(ears):
                self.told.get(timeout=0.3)
        except queue.Empty as error:
            raise NotThere("not all are connected yet") from error

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)
        return timed(number, lambda: _first(self.session.get("ping", payload=body)))

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body = body_of(100)
        pending: deque[Any] = deque()
        for _ in range(number):
            if len(pending) == OPEN:
                _first(pending.popleft())
            pending.append(self.session.get("ping", payload=body))
        for replies in pending:
            _first(replies)

    def oneway(self, number: int) -> None:
        self._flood("pose", number, 1)

    def fanout(self, number: int) -> None:
        self._flood("tick", number, LISTENERS)

    def _flood(self, key: str, number: int, ears: int) -> None:
        body, publisher = body_of(100, COUNT), self.topics[key]
        for _ in range(number):
            publisher.put(body)
        publisher.put(MARK)
        check_arrived(number, *(int(self.told.get(timeout=20)) for _ in range(ears)))

    def stop(self) -> None:
        if hasattr(self, "session"):
            self.session.close()
        super().stop()


def _first(replies: Any) -> None:
    assert next(iter(replies)).ok is not None
